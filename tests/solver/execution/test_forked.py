"""Tasks in forked children: the answers of the tasks, in order, whatever becomes of a child."""

import os
import subprocess
import sys
import threading
from functools import partial

import pytest

from cpcal.solver.execution import forked
from cpcal.solver.execution.forked import side_by_side

TASKS = [partial(pow, 3, n) for n in range(7)]


@pytest.fixture(params=[0, 1, 2, 3])
def children(request, monkeypatch):
    monkeypatch.setattr(forked, "_children", lambda tasks: request.param)
    return request.param


def dies(parent):
    if os.getpid() != parent:
        os._exit(9)
    return "done here"


def test_answers_come_in_order(children):
    with side_by_side(TASKS) as answers:
        assert answers() == [3**n for n in range(7)]


def test_what_a_child_did_not_answer_is_done_here(children):
    with side_by_side([partial(dies, os.getpid()), *TASKS]) as answers:
        assert answers() == ["done here", *(3**n for n in range(7))]


def test_what_a_task_raises_is_raised(children):
    with side_by_side([*TASKS, partial(int, "x")]) as answers, pytest.raises(ValueError, match="invalid literal"):
        answers()


def test_a_large_answer_of_a_child_does_not_block_the_others(children):
    with side_by_side([partial(bytes, 1 << 20)] * 5) as answers:
        assert [len(one) for one in answers()] == [1 << 20] * 5


def test_no_child_is_left_where_nobody_asked_for_the_answers():
    code = """
import os, time
from cpcal.solver.execution import forked
forked._children = lambda tasks: 2
try:
    with forked.side_by_side([lambda: time.sleep(100)] * 2):
        raise KeyboardInterrupt
except KeyboardInterrupt:
    try:
        os.waitpid(-1, 0)
    except ChildProcessError:
        print("no child")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=50)
    assert done.stdout == "no child\n"


def test_beside_other_threads_no_child_is_forked():
    found, over = [], threading.Event()
    waiting = threading.Thread(target=over.wait)
    waiting.start()
    found.append(forked._children(4))
    over.set()
    waiting.join()
    assert found == [0]
