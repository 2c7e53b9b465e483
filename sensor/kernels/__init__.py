"""The compiled kernels of the sensor: the paper's equations, one file for each step of the physics.

Between two frames the log intensity u is linear in time. A *setting* is one sensor's electronics
and time axis: contrast threshold C, photoreceptor poles a = 2 pi f_cutoff, and the frame times.
The state of a pixel at a frame time, float64:

u      log intensity, log(I + I_dark)
v1, v2 outputs of the photoreceptor's two poles; v2 is the voltage L of Eq. (1)
memory the level that the comparator compares v2 with

`advance` loops over the pixels and calls the other files: `radiance`, `photoreceptor`, `silence`,
`comparator` with `crossings`, `noise`, `packing`. `fifo` models the readout bus. `pixel` has the
same for one pixel at a time, as a thread of a GPU runs it; `elementary` has exp and log.
"""
