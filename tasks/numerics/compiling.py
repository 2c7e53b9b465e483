"""The decorators that compile the kernels of methods."""

from __future__ import annotations

from pathlib import Path

from sensor.compiling import compiler

_FOLDERS = (Path(__file__).parent, Path(__file__).parents[1] / "methods")

jit = compiler(*_FOLDERS)
"""Compile a kernel without fast math."""

jit_contract = compiler(*_FOLDERS, fastmath={"contract"})
"""Compile a kernel; "contract" allows fused multiply-add, no other fast math."""
