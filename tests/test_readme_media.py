"""The committed pictures of README.md: small, and what the command writes."""

from pathlib import Path

from PIL import Image

from experiments import readme_media

DOCS = Path(__file__).parent.parent / "docs"


def test_pictures_are_written_at_their_size(tmp_path):
    readme_media.write_media(tmp_path / "docs", force_time=0.2, robots_time=0.2, tuned_time=0.02)
    written = sorted(path.name for path in (tmp_path / "docs").iterdir())
    assert written == ["contact_force.png", "robots.gif", "tuning.png"]
    for name in written:
        with Image.open(tmp_path / "docs" / name) as written, Image.open(DOCS / name) as committed:
            assert written.format == committed.format
            assert written.width == committed.width
            assert (DOCS / name).stat().st_size < 1.5e6
    with Image.open(DOCS / "robots.gif") as committed:
        assert committed.n_frames == round(25 * readme_media.TURN) + 1


def test_folder_that_cannot_be_written(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert readme_media.main(["--out", str(tmp_path / "file")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("readme_media: error: --out: must be a folder that can be written, was ")
    assert said.count("\n") == 1
