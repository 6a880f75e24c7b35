"""Batches: full ones whatever the number of elements, one compilation for all threads, precision of the arguments."""

import threading
import time

import jax
import numpy as np
import pytest

from coopmm_jax.sweeps.batch import Program, concurrently, in_batches, prepare, run, slots

traced = []


def scaled(factor, x, offset):
    traced.append(factor)
    return {"y": factor * x + offset}


@pytest.mark.parametrize("count", [1, 3, 4, 5])
def test_batches_are_full_and_results_in_order(count):
    seen = []

    def compute(_, rows):
        seen.append(rows.tolist())
        return rows[:, None] * [1, 2], -rows

    pairs, negative = in_batches(compute, count, 4)
    assert {len(batch) for batch in seen} == {4}
    assert max(map(max, seen)) == count - 1
    assert pairs.tolist() == [[i, 2 * i] for i in range(count)]
    assert negative.tolist() == [-i for i in range(count)]


def test_threads_that_need_equal_programs_compile_one():
    traced.clear()
    batch, shared = np.arange(6.0).reshape(2, 3), (np.float64(0.5),)
    program, device = Program(scaled, (3.0,)), slots()[0]
    results = list(concurrently(lambda device, _: run(program, device, (batch,), shared), range(6), [device] * 3))
    assert traced == [3.0]
    for result in results:
        np.testing.assert_array_equal(result["y"], 3.0 * batch + 0.5)
    run(Program(scaled, (4.0,)), device, (batch,), shared)
    run(program, device, (batch[:1],), shared)
    assert traced == [3.0, 4.0, 3.0]


def test_prepared_programs_are_not_compiled_again():
    traced.clear()
    program, device = Program(scaled, (5.0,)), slots()[0]
    shapes = [jax.ShapeDtypeStruct(shape, np.float64) for shape in ((2,), ())]
    prepare(program, device, (shapes[0],), (shapes[1],))
    assert run(program, device, (np.ones(2),), (np.float64(1.0),))["y"].tolist() == [6.0, 6.0]
    assert traced == [5.0]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_precision_is_that_of_the_arguments(dtype):
    result = run(Program(scaled, (3.0,)), slots()[0], (np.ones(2, dtype),), (dtype(0.0),))
    assert result["y"].dtype == dtype


def test_items_are_taken_only_when_a_slot_is_free():
    taken = []

    def items():
        for i in range(20):
            taken.append(i)
            yield i

    slots = ["a", "b", "a", "b"]
    finished = 0
    for slot, _ in concurrently(lambda slot, item: (slot, item), items(), slots):
        assert slot in slots
        finished += 1
        assert len(taken) <= finished + len(slots) + 1
    assert finished == 20


def test_an_exception_ends_the_work():
    def fail(slot, item):
        raise ValueError(item)

    with pytest.raises(ValueError, match=r"^0$"):
        list(concurrently(fail, range(10**9), [None]))


def test_of_several_exceptions_the_first_items_is_raised():
    both = threading.Barrier(2)

    def fail(_, item):
        both.wait(10.0)
        time.sleep(0.05 * (1 - item))
        raise ValueError(item)

    with pytest.raises(ValueError, match=r"^0$"):
        list(concurrently(fail, range(2), [None, None]))
