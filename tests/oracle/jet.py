"""Second-order jets: a number together with its exact first and second derivatives.

A jet carries the value, the gradient and the Hessian of a quantity with respect to a fixed list
of independent variables. Arithmetic propagates all three by the chain rule, so the derivatives
are as accurate as the value itself: no step is taken and no digits are lost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Union

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Scalar = Union["Jet", Array, float]


def _outer(left: Array, right: Array) -> Array:
    return left[..., :, None] * right[..., None, :]


@dataclass(frozen=True, eq=False)
class Jet:
    """Value of shape ``s``, gradient of shape ``s + (n,)``, Hessian of shape ``s + (n, n)``."""

    value: Array
    gradient: Array
    hessian: Array

    # numpy must hand ``array * jet`` over to this class instead of looping over the elements.
    __array_ufunc__ = None

    def _lift(self, other: Scalar) -> Jet:
        return other if isinstance(other, Jet) else constant(other, self.gradient.shape[-1])

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.gradient, -self.hessian)

    def __add__(self, other: Scalar) -> Jet:
        o = self._lift(other)
        return Jet(self.value + o.value, self.gradient + o.gradient, self.hessian + o.hessian)

    def __sub__(self, other: Scalar) -> Jet:
        return self + (-self._lift(other))

    def __mul__(self, other: Scalar) -> Jet:
        o = self._lift(other)
        cross = _outer(self.gradient, o.gradient)
        return Jet(
            self.value * o.value,
            self.value[..., None] * o.gradient + o.value[..., None] * self.gradient,
            self.value[..., None, None] * o.hessian
            + o.value[..., None, None] * self.hessian
            + cross
            + np.swapaxes(cross, -1, -2),
        )

    def reciprocal(self) -> Jet:
        inverse = 1.0 / self.value
        return Jet(
            inverse,
            -(inverse**2)[..., None] * self.gradient,
            (2.0 * inverse**3)[..., None, None] * _outer(self.gradient, self.gradient)
            - (inverse**2)[..., None, None] * self.hessian,
        )

    def __truediv__(self, other: Scalar) -> Jet:
        return self * self._lift(other).reciprocal()

    __radd__ = __add__
    __rmul__ = __mul__

    def __rsub__(self, other: Scalar) -> Jet:
        return -self + other

    def __rtruediv__(self, other: Scalar) -> Jet:
        return self._lift(other) * self.reciprocal()

    def square(self) -> Jet:
        return self * self

    def total(self) -> Jet:
        """Sum over the first axis."""
        return Jet(self.value.sum(0), self.gradient.sum(0), self.hessian.sum(0))


def constant(value: Scalar, variables: int) -> Jet:
    """A quantity that depends on none of the ``variables`` independent variables."""
    if isinstance(value, Jet):
        return value
    array = np.asarray(value, dtype=np.float64)
    return Jet(
        array,
        np.zeros((*array.shape, variables)),
        np.zeros((*array.shape, variables, variables)),
    )


def independent(values: Sequence[float | Array]) -> list[Jet]:
    """The independent variables themselves; arrays stand for many points at once."""
    points = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in values))
    n, shape = len(points), points[0].shape
    curvature = np.zeros((*shape, n, n))
    return [
        Jet(point, np.broadcast_to(seed, (*shape, n)), curvature)
        for point, seed in zip(points, np.eye(n), strict=True)
    ]


# Exact for polynomials up to degree 19; the integrands here are of degree 8 at most.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)


def _first_axis(array: Array, axes: int) -> Array:
    return array.reshape(-1, *(1,) * (axes - 1))


def integral(integrand: Callable[[Jet], Jet], lower: Jet, upper: Jet) -> Jet:
    """Gauss-Legendre integral whose limits (and integrand) may depend on the variables.

    ``integrand`` receives the nodes along a new first axis, so that everything else broadcasts
    against them. The limits may have such an axis of their own: integrals can be nested.
    """
    middle, half = (upper + lower) * 0.5, (upper - lower) * 0.5
    samples = integrand(middle + half * _first_axis(_NODES, half.value.ndim + 1))
    return (samples * _first_axis(_WEIGHTS, samples.value.ndim)).total() * half
