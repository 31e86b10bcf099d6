"""That kernels are being compiled is said in one line, and not again before a pause."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from trailmark.compiled.report import CompilingReport, compiling_for


def test_compiling_is_reported_once_in_a_row() -> None:
    clock, said = [0.0], list[str]()
    report = CompilingReport(said.append, lambda: clock[0])

    def compile_at(begin: float, end: float, module: str = "trailmark.heap") -> None:
        what: Any = SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__=module))})
        clock[0] = begin
        report.on_start(what)
        clock[0] = end
        report.on_end(what)

    compile_at(10.0, 10.6)
    assert said == []  # what is over at once is not worth a word
    with compiling_for("planning"):
        compile_at(10.7, 11.4)
        compile_at(11.5, 20.0)
    compile_at(20.1, 21.0)
    assert len(said) == 1
    assert said[0].startswith("compiling the kernels for planning:")
    assert "once" in said[0]
    compile_at(60.0, 65.0, "somebody.else")
    compile_at(65.1, 67.0, "somebody.else")
    assert len(said) == 1
    compile_at(100.0, 101.5, "trailmark.curves.words")
    compile_at(101.6, 103.0, "trailmark.curves.words")
    assert len(said) == 2
    assert "the kernels for trailmark.curves.words" in said[1]
    assert "once" not in said[1]
