"""How the kernels of representations are compiled."""

from pathlib import Path

from sensor.compiling import compiler

jit = compiler(Path(__file__).parent)
