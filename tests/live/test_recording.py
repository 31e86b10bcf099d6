from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.exploration.made_exploration import made_exploration

from trailmark.errors import FormatError
from trailmark.exploration.exploration_folder import save_exploration
from trailmark.live import recording
from trailmark.live.recording import is_exploration, recording_of


@pytest.fixture
def folder(tmp_path: Path) -> str:
    """Return where an exploration is kept."""
    save_exploration(made_exploration(), tmp_path / "run")
    return str(tmp_path / "run")


def played(found: dict[str, Any]) -> list[np.ndarray[Any, Any]]:
    """Return the cells after each step."""
    cells = np.zeros(found["grid"]["rows"] * found["grid"]["columns"], np.uint8)
    after = []
    for step in found["steps"]:
        at = np.frombuffer(base64.b64decode(step["at"]), "<i4")
        assert not cells[at].any()
        cells[at] = np.frombuffer(base64.b64decode(step["cells"]), np.uint8)
        after.append(cells.copy())
    return after


def test_all_steps_end_with_the_map(folder: str) -> None:
    result, found = made_exploration(), recording_of(folder)
    assert is_exploration(folder)
    assert (found["status"], found["reason"]) == (result.status, result.reason)
    assert found["grid"]["size"] == result.known.cell
    assert found["grid"]["origin"] == list(result.known.origin)
    after = played(found)
    assert len(after) == len(result.history)
    assert np.array_equal(after[-1], result.known.state.ravel())
    for cells, row in zip(after, result.history, strict=True):
        assert np.array_equal(cells > 0, (result.first_known.ravel() <= np.float32(row.time)) & (after[-1] > 0))
    assert found["steps"][-1]["pose"] == pytest.approx(result.history[-1].pose, abs=1e-3)


def test_a_long_one_is_thinned_to_the_same_end(folder: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "MAX_STEPS", 2)
    found = recording_of(folder)
    assert len(found["steps"]) == 2
    assert np.array_equal(played(found)[-1], made_exploration().known.state.ravel())


@pytest.mark.slow
def test_what_is_missing_or_damaged_is_told(folder: str, tmp_path: Path) -> None:
    assert not is_exploration(str(tmp_path))
    path = Path(folder)
    (path / "summary.json").write_text("{")
    assert recording_of(folder)["status"] == "interrupted"
    (path / "map.yaml").write_text("resolution: 1.0\nimage: nothing.pgm\n")
    with pytest.raises(FormatError, match="nothing"):
        recording_of(folder)
    (path / "map.yaml").unlink()
    with pytest.raises(FormatError, match=r"map\.yaml"):
        recording_of(folder)
