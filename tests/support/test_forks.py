"""What is forked says and comes to what a new interpreter does, whether or not it ends as that does."""

from __future__ import annotations

import subprocess
import sys

import pytest
from tests.support.forks import Forks, complaints

PROGRAMS = {
    "it ends": "print('done')",
    "a status": "import sys; sys.exit(3)",
    "a reason": "import sys; sys.exit('no')",
    "an error": "raise ValueError('no idea')",
    "an interrupt": "raise KeyboardInterrupt",
    "it is killed": "import os; os.kill(os.getpid(), 9)",
    "a thread": "import threading, time\nthreading.Thread(target=lambda: [time.sleep(0.05), print('late')]).start()",
    "at the end": "import atexit; atexit.register(print, 'bye')",
    "what it made": "class Made:\n    def __del__(self): print('gone')\nmade = Made()\nmade.own = made",
}


@pytest.mark.slow
@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("name", PROGRAMS)
def test_it_is_as_a_new_interpreter(name: str, whole: bool, forks: Forks) -> None:
    words = ["-c", PROGRAMS[name]]
    new = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
    done = forks.run(words, timeout=60.0, whole=whole)
    assert (done.returncode, done.stdout) == (new.returncode, new.stdout)
    assert complaints(done).splitlines()[-1:] == new.stderr.splitlines()[-1:]


@pytest.mark.slow
def test_the_end_of_the_interpreter_can_be_left_out(forks: Forks) -> None:
    program = "import os, json\nclass Last:\n    def __del__(self, say=os.write): say(1, b'ended')\njson.last = Last()"
    assert forks.run(["-c", program], timeout=60.0).stdout == ""
    assert forks.run(["-c", program], timeout=60.0, whole=True).stdout == "ended"
