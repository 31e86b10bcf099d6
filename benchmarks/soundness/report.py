"""What a part of the campaign counts and finds."""

from __future__ import annotations

import pickle
import sys
import traceback
from collections import Counter
from pathlib import Path

from benchmarks.soundness import cases
from benchmarks.soundness.cases import Question
from trailmark.errors import TrailmarkError
from trailmark.world import World

__all__ = ["Report"]

SAVED = 4
"""Cases of one kind that a chunk writes; all are counted."""


class Report:
    """Counts of what was judged, and the cases in which the answer was wrong.

    Args:
        folder: where cases are written.
        asking: file that holds what is being asked, should the process die of it.
        version: of the code asked.

    Attributes:
        counts: how many of what were judged.
        wrong: how many of each kind of wrong answer.
        found: names of the cases written.
    """

    def __init__(self, folder: Path, asking: Path, version: str) -> None:
        self.folder, self.asking, self.version = folder, asking, version
        self.counts: Counter[str] = Counter()
        self.wrong: Counter[str] = Counter()
        self.found: list[str] = []
        # Nothing is being asked yet.
        asking.unlink(missing_ok=True)

    def count(self, what: str, n: int = 1) -> None:
        """Count what was judged."""
        self.counts[what] += int(n)

    def about_to_ask(self, world: World, asked: Question) -> None:
        """Keep a question, so that it is known if the process dies of it."""
        self.asking.write_bytes(pickle.dumps((world, asked)))

    def ask(self, world: World, asked: Question) -> bool:
        """Ask a question; return whether the answer is right."""
        self.about_to_ask(world, asked)
        try:
            complaint = cases.ask(world, asked)
        except TrailmarkError as error:
            # Also an answer: the question may be out of range.
            self.count(f"refused: {type(error).__name__}")
            return True
        except Exception:
            complaint = traceback.format_exc(limit=-2)
        if complaint is not None:
            self.case(kind_of(complaint), world, asked, complaint)
        return complaint is None

    def raised(self) -> None:
        """Keep what was being asked when an exception came: none may, of what is asked here."""
        self._of_the_last("exception", traceback.format_exc(limit=-3))

    def internal(self, message: str) -> None:
        """Keep what was asked last, since the library has found an error of its own."""
        self._of_the_last("internal", message)

    def _of_the_last(self, kind: str, complaint: str) -> None:
        if self.asking.exists():
            world, asked = pickle.loads(self.asking.read_bytes())  # noqa: S301  our own file
            self.case(kind, world, asked, complaint)
        else:
            self.wrong[kind] += 1
            print(complaint, file=sys.stderr)

    def case(self, kind: str, world: World, asked: Question, complaint: str) -> None:
        """Keep a question that was answered wrongly."""
        self.wrong[kind] += 1
        if self.wrong[kind] <= SAVED:
            text = f"{complaint} ({self.version})"
            asked = Question(asked.what, asked.states, asked.cost, asked.seconds, asked.seed, text)
            self.found.append(cases.save(self.folder, kind, world, asked).name)


def kind_of(complaint: str) -> str:
    """Return a short name of a complaint's kind."""
    for word, kind in (
        ("Traceback", "exception"),
        ("nearest", "nearest"),
        ("infeasible", "infeasible"),
        ("enclosure", "enclosure"),
        ("bound", "bound"),
        ("overlaps", "overlap"),
        ("collides", "collision"),
        ("not valid", "refusal"),
        ("least clearance", "clearance"),
    ):
        if word in complaint:
            return kind
    return "other"
