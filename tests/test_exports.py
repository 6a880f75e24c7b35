"""Results in other programs: netCDF, Zarr, CSV, and how a notebook shows data sets."""

import csv
import json
import warnings
from unittest.mock import MagicMock

import numpy as np
import pytest
import xarray

import coopmm_jax as cm
from coopmm_jax.status import Status
from coopmm_jax.sweeps import contents, report
from coopmm_jax.sweeps.statistics import outcomes, read_results
from tests.sweeps import REQUIRED


def same_arrays(found, expected):
    """Arrays of both data sets are equal, but for those without entries."""
    names = [name for name, values in expected.variables.items() if values.size]
    assert set(found.variables) == set(names)
    for name in names:
        np.testing.assert_array_equal(found[name].values, expected[name].values)


def test_a_run_is_a_netcdf_file(simulated_paper, tmp_path):
    data = simulated_paper.to_xarray()
    data.to_netcdf(tmp_path / "run.nc")
    with xarray.open_dataset(tmp_path / "run.nc") as found:
        same_arrays(found, data)
        assert found.attrs["scenario"] == simulated_paper.scenario.to_toml()
        assert json.loads(found.attrs["metrics"]) == simulated_paper.metrics
        assert np.isnan(found.attrs["status_time"])


def test_a_sweep_is_a_netcdf_file(kept, many, tmp_path):
    for name, data in (("kept", kept), ("without series", many)):
        data.to_netcdf(tmp_path / f"{name}.nc")
        with xarray.open_dataset(tmp_path / f"{name}.nc") as found:
            same_arrays(found, data)
            assert all(isinstance(value, str | int | np.integer) for value in found.attrs.values())
            assert "jax" in json.loads(found.attrs["versions"])


def test_xarray_opens_a_store_that_has_grown_and_warns_of_nothing(sweep, tmp_path):
    sweep(8, out=tmp_path / "s.zarr")
    grown = sweep(20, out=tmp_path / "s.zarr", resume=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = xarray.open_zarr(tmp_path / "s.zarr", chunks=None)
    assert found.sample.values.tolist() == list(range(20))
    np.testing.assert_array_equal(found.metrics.values, grown.metrics.values)
    opened = cm.open_sweep(tmp_path / "s.zarr")
    xarray.testing.assert_identical(opened, grown)
    assert opened.metrics.sel(sample=[3, 19], metric="force_min").to_pandas().index.tolist() == [3, 19]


def test_growth_that_is_cut_off_at_its_end_is_made_up_for(sweep, tmp_path, monkeypatch):
    sweep(8, out=tmp_path / "s.zarr")
    with monkeypatch.context() as patch:
        patch.setattr(contents, "consolidate", MagicMock(side_effect=KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            sweep(20, out=tmp_path / "s.zarr", resume=True)
    assert cm.open_sweep(tmp_path / "s.zarr").sizes["sample"] == 20
    assert xarray.open_zarr(tmp_path / "s.zarr", chunks=None).sample.values.tolist() == list(range(20))


def test_a_notebook_shows_data_sets_in_short(kept, simulated_paper):
    counts = {status.name: int((kept.status == status).sum()) for status in Status if (kept.status == status).any()}
    ended = ", ".join(f"{count} {name}" for name, count in counts.items())
    assert kept.about() == [f"Sweep: 100 of 100 samples computed, {ended}"]
    for data in (kept, kept.isel(sample=slice(3)), simulated_paper.to_xarray()):
        page = data._repr_html_()
        assert "contact_radius" not in page
        assert len(data.attrs["scenario"]) > 1000


def test_tables_of_a_report_are_csv_files(kept, tmp_path):
    results = read_results(kept)
    report.write_numbers(tmp_path, results)
    tables = {path.stem: list(csv.DictReader(path.read_text().splitlines())) for path in tmp_path.glob("*.csv")}
    assert set(tables) == {"requirements", "metrics", "importance", "failed"}
    rates = {row["requirement"]: float(row["probability"]) for row in tables["requirements"]}
    assert rates == {row.requirement: row.success.estimate for row in outcomes(results)}
    (force,) = (row for row in tables["metrics"] if row["metric"] == "force_min")
    assert float(force["worst"]) == kept.metrics.sel(metric="force_min", sample=int(force["worst_sample"]))
    assert {row["metric"] for row in tables["importance"]} == {"completed", *REQUIRED}
