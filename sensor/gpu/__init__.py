"""The sensor on an NVIDIA GPU: the kernels of `sensor.kernels.pixel`, one thread for each pixel.

`sensor.engine` imports it only where `device="cuda"` is asked for; it needs numba-cuda.
"""
