"""Paths through given points, from a scenario file or a CSV file: a series is fitted to them when they are loaded."""

from __future__ import annotations

import hashlib
from typing import Annotated, Any, NamedTuple

from coopmm_jax.algebra.later import np
from coopmm_jax.algebra.types import PyTree, Scalar, Vector
from coopmm_jax.errors import UserError
from coopmm_jax.files import resolve_path
from coopmm_jax.kinds import fits
from coopmm_jax.kinds.paths import Chebyshev, Fourier, span
from coopmm_jax.kinds.protocol import quantity
from coopmm_jax.kinds.registry import register

_FEWEST = 4  # points
_LEAST = 1e-9  # [m] from one point to the next
_FARTHEST = 1e6  # [m] from the world's axes, where a millimetre is still told apart
_DIGITS = 16  # of a SHA-256, enough to tell files apart
_MUST = "a CSV file with two columns of numbers"

Closed = Annotated[bool, quantity("whether it goes on from its last point to its first")]
Order = Annotated[int, quantity("harmonics of a closed path, degree of an open one [-]", at_least=1, at_most=40)]
Tolerance = Annotated[float, quantity("largest distance of the series from the spline through the points [m]", above=0)]


@register("path", "waypoints")
class Waypoints(NamedTuple):
    """Path through points (x, y), closed or open."""

    curve: PyTree  # ``Fourier`` or ``Chebyshev``
    deviation: Scalar  # of the curve from the spline through the points [m]

    @classmethod
    def build(
        cls,
        x: Annotated[Vector, quantity("of the points [m]")],
        y: Annotated[Vector, quantity("of the points [m]")],
        closed: Closed = True,
        order: Order = 9,
        tolerance: Tolerance = 0.01,
    ) -> Waypoints:
        """Path through points.

        Args:
            x: of the points (n,) [m].
            y: of the points (n,) [m].
            closed: whether it goes on from its last point to its first.
            order: harmonics of a closed path, degree of an open one.
            tolerance: largest deviation [m].

        Raises:
            UserError: points that make no path, or a fit that deviates too far.
        """
        if len(x) != len(y):
            raise UserError("y", f"a list of {len(x)}, as long as x", f"a list of {len(y)}")
        return cls(*_fitted(np.array([x, y]).T, closed, order, tolerance, "x"))

    def point(self, phase: Scalar) -> tuple[Scalar, Scalar]:
        """World position (x, y) at a scalar phase [m]."""
        return self.curve.point(phase)

    def span(self) -> tuple[float, float]:
        """Phases (2,) from end to end."""
        return span(self.curve)


@register("path", "csv")
class Csv(NamedTuple):
    """Path through the points of a CSV file: x and y [m] in its first two columns, below a header if it has one."""

    curve: PyTree  # ``Fourier`` or ``Chebyshev``
    deviation: Scalar  # of the curve from the spline through the points [m]

    @classmethod
    def build(
        cls,
        file: Annotated[str, quantity("its name, from the working directory")],
        closed: Closed = True,
        order: Order = 9,
        tolerance: Tolerance = 0.01,
        content: Annotated[str, quantity("file and checksum of what was read, in a scenario that was loaded")] = "",
    ) -> Csv:
        """Path through the points of a file.

        Args:
            file: its name.
            closed: whether it goes on from its last point to its first.
            order: harmonics of a closed path, degree of an open one.
            tolerance: largest deviation [m].
            content: of the file, see ``pinned``.

        Raises:
            UserError: a file that cannot be read, points that make no path, or a fit that deviates too far.
        """
        del content
        return cls(*_fitted(_read(file), closed, order, tolerance, "file"))

    @classmethod
    def pinned(cls, file: str, content: str, **others: Any) -> dict[str, str]:
        """Field ``content`` of a file as it is now, so that stores and runs that are gone on with notice another one.

        Args:
            file: its name.
            content: what it had when the scenario was loaded before; empty, or of another file: nothing is known.
            others: fields.

        Raises:
            UserError: the file cannot be read, or has changed.
        """
        del others
        now = f"{file} {hashlib.sha256(_bytes(file)).hexdigest()[:_DIGITS]}"
        if content.startswith(f"{file} ") and content != now:
            raise UserError("content", f"left out, or that of the file as it is now ({now})", content)
        return {"content": now}

    def point(self, phase: Scalar) -> tuple[Scalar, Scalar]:
        """World position (x, y) at a scalar phase [m]."""
        return self.curve.point(phase)

    def span(self) -> tuple[float, float]:
        """Phases (2,) from end to end."""
        return span(self.curve)


def _read(file: str) -> np.ndarray:
    try:
        lines = _bytes(file).decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise UserError("file", _MUST, f"{file} ({error})") from None
    rows = [line.replace(";", ",").split(",")[:2] for line in lines if line.strip()]
    try:
        float(rows[0][0])
    except (ValueError, IndexError):
        rows = rows[1:]
    try:
        return np.array([[float(x), float(y)] for x, y in rows]).reshape(-1, 2)
    except ValueError as error:
        raise UserError("file", _MUST, f"{file} ({error})") from None


def _bytes(file: str) -> bytes:
    try:
        return resolve_path(file, "file").read_bytes()
    except OSError as error:
        raise UserError("file", _MUST, f"{file} ({error.strerror})") from None


def _fitted(
    points: np.ndarray, closed: bool, order: int, tolerance: float, field: str
) -> tuple[Fourier | Chebyshev, float]:
    """Curve through points (n, 2), and its deviation [m]."""
    if len(points) < _FEWEST:
        raise UserError(field, f"at least {_FEWEST} points", len(points))
    far = ~(np.abs(points) < _FARTHEST).all(axis=1)
    if far.any():
        x, y = points[far.argmax()]
        must = f"of points within {_FARTHEST:g} m of the world's axes"
        raise UserError(field, must, f"({x:g}, {y:g}) at point {far.argmax() + 1}")
    around = np.concatenate([points, points[:1]]) if closed else points
    if np.linalg.norm(np.diff(around, axis=0), axis=1).min() < _LEAST:
        raise UserError(
            field, "points apart from one another, the first of a closed path given once", "two in one place"
        )
    fit = fits.closed_fit(points, order) if closed else fits.open_fit(points, order)
    if fit.deviation > tolerance:
        must = f"enough for a deviation of {tolerance:g} m at most (it is {fit.deviation:.3g} m)"
        raise UserError("order", must, order)
    if not closed:
        x, y = (tuple(row) for row in fit.coefficients.tolist())
        return Chebyshev(x, y), fit.deviation
    (x, y), (x0, y0) = fit.coefficients[:, 1:], fit.coefficients[:, 0].real
    xc, xs, yc, ys = (tuple(values.tolist()) for values in (x.real, -x.imag, y.real, -y.imag))
    return Fourier(float(x0), float(y0), xc, xs, yc, ys), fit.deviation
