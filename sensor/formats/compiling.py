"""How the formats' kernels are compiled."""

from pathlib import Path

from sensor.compiling import compiler

jit = compiler(Path(__file__).parent)
