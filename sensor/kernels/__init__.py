"""Every jitted kernel of the sensor: the paper's equations, one step of the physics a file.

Between two frames the log intensity u is a straight line in time. One *setting* is a pixel's
electronics together with a time axis: contrast threshold C, photoreceptor poles a = 2 pi f_cutoff,
and the frames' times. A pixel's state at a frame time, float64:

u      log intensity, log(I + I_dark)
v1, v2 outputs of the photoreceptor's two poles; v2 is the voltage L of Eq. (1)
memory the level that v2 is compared with

`advance` walks over the pixels and calls the rest: `radiance`, `photoreceptor`, `silence`,
`comparator` with `crossings`, `noise`, `packing`. `fifo` is the bus behind them.
"""
