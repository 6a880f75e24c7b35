"""Data sets that a notebook shows in short, and whose attributes every file format takes."""

from __future__ import annotations

from html import escape
from typing import Any

import xarray

_SHOWN = 100  # characters of an attribute in a notebook; the text of a scenario is a screenful


class Labelled(xarray.Dataset):
    """Data set of xarray; in a notebook, what it holds stands above it and long attributes are cut.

    >>> data = Labelled(attrs={"scenario": "base = 'paper'\\n" * 99})
    >>> "base = &#x27;paper&#x27; base" in data._repr_html_(), len(data.attrs["scenario"])
    (True, 1485)
    """

    __slots__ = ()

    def _repr_html_(self) -> str:
        brief = {name: _cut(value) for name, value in self.attrs.items()}
        head = "<br>".join(escape(line) for line in self.about())
        return f"<div>{head}</div>{xarray.Dataset._repr_html_(self.drop_attrs(deep=False).assign_attrs(brief))}"

    def to_netcdf(self, *arguments: Any, **options: Any) -> Any:
        """Write a netCDF file as xarray does, without arrays that have no entries, such as series of no samples.

        In netCDF a dimension of length 0 is one that grows, which not every program reads.
        """
        nothing = [name for name, size in self.sizes.items() if size == 0]
        return xarray.Dataset.to_netcdf(self.drop_dims(nothing), *arguments, **options)

    def about(self) -> list[str]:
        """Lines that stand above the data set in a notebook."""
        return []


def _cut(value: object) -> object:
    text = " ".join(value.split()) if isinstance(value, str) else ""
    return f"{text[:_SHOWN]}…" if len(text) > _SHOWN else value
