"""Pictures of shipped scenarios, drawn of other runs."""

import numpy as np

from experiments import scenario_pictures


def test_frame_shows_its_time(simulated_paper):
    figure = scenario_pictures.frame(simulated_paper, 0.4)
    figure.draw_without_rendering()
    assert "t = 0.40 s" in [axes.get_title(loc="left") for axes in figure.axes] + [
        text.get_text() for text in figure.findobj(lambda x: hasattr(x, "get_text"))
    ]


def test_gaps_are_in_millimetres(simulated_paper, monkeypatch):
    monkeypatch.setattr(scenario_pictures, "KNOCKED", (0.2, 0.3))
    figure = scenario_pictures.gaps({"one": simulated_paper})
    figure.draw_without_rendering()
    (axes,) = figure.axes
    line = axes.get_lines()[0]
    kept = np.isin(simulated_paper.t, line.get_xdata())
    np.testing.assert_allclose(line.get_ydata(), 1e3 * simulated_paper.constraint_residual[kept, 0], rtol=1e-12)
    assert line.get_xdata().min() >= 0.2


def test_folder_that_cannot_be_written(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert scenario_pictures.main(["--out", str(tmp_path / "file")]) == 2
    assert capsys.readouterr().err.startswith("scenario_pictures: error: --out: must be a folder")
