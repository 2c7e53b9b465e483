"""Vectors, as tuples of three, and matrices, as three rows, which compilers keep in registers."""

from __future__ import annotations

from tasks.numerics.compiling import jit_contract_in_place

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]


@jit_contract_in_place
def cross(a, b):
    """Return the cross product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@jit_contract_in_place
def dot(a, b):
    """Return the dot product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit_contract_in_place
def mixed(a, u, b, v, c, w):
    """Return a u + b v + c w of three vectors."""
    return (
        a * u[0] + b * v[0] + c * w[0],
        a * u[1] + b * v[1] + c * w[1],
        a * u[2] + b * v[2] + c * w[2],
    )


@jit_contract_in_place
def rows_of(A):
    """Return the rows of a (3, 3) array as a matrix."""
    return (A[0, 0], A[0, 1], A[0, 2]), (A[1, 0], A[1, 1], A[1, 2]), (A[2, 0], A[2, 1], A[2, 2])


@jit_contract_in_place
def times(A, v):
    """Return the product of a matrix and a vector."""
    x, y, z = v
    return (
        A[0][0] * x + A[0][1] * y + A[0][2] * z,
        A[1][0] * x + A[1][1] * y + A[1][2] * z,
        A[2][0] * x + A[2][1] * y + A[2][2] * z,
    )


@jit_contract_in_place
def transposed_times(A, v):
    """Return the product of the transpose of a matrix and a vector."""
    return mixed(v[0], A[0], v[1], A[1], v[2], A[2])
