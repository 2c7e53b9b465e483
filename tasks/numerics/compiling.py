"""The decorators that compile the kernels of methods."""

from __future__ import annotations

from pathlib import Path

from sensor.compiling import compiler

_FOLDERS = (Path(__file__).parent, Path(__file__).parents[1] / "methods")

jit = compiler(*_FOLDERS)
"""Compile a kernel without fast math."""

jit_contract = compiler(*_FOLDERS, fastmath={"contract"})
"""Compile a kernel; "contract" allows fused multiply-add, no other fast math."""

jit_in_place = compiler(*_FOLDERS, _nrt=False)
"""Compile a kernel that neither allocates nor returns arrays, without fast math.

It does not count references to each array of a tuple, which takes long to compile.
"""

jit_contract_in_place = compiler(*_FOLDERS, fastmath={"contract"}, _nrt=False)
"""As `jit_in_place`, with "contract"."""

inlined = compiler(*_FOLDERS, _nrt=False, inline="always")
"""Compile a kernel and paste it into its callers, with their fast math.

LLVM then optimizes the code once, not once for each level of calls.
"""
