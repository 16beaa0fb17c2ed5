"""A benchmark whose rivals are not installed says so at once."""

from __future__ import annotations

import argparse

import pytest

from benchmarks import extra


@pytest.mark.parametrize("found", [None, object()])
def test_missing_rivals_are_told_with_the_command_that_installs_them(
    found: object, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(extra, "find_spec", lambda name: found)
    parser = argparse.ArgumentParser(prog="blind")
    if found is not None:
        extra.require_pysindy(parser)
        return
    with pytest.raises(SystemExit, match="2"):
        extra.require_pysindy(parser)
    assert "pip install 'hopper-flight[ground,bench]'" in capsys.readouterr().err
