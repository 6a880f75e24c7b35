"""The command that writes the pictures of README.md; test_pages.py has it write them."""

from experiments import readme_media


def test_folder_that_cannot_be_written(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert readme_media.main(["--out", str(tmp_path / "file")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("readme_media: error: --out: must be a folder that can be written, was ")
    assert said.count("\n") == 1
