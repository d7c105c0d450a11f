"""Times of steps: their middle and their late ones, and a fixed piece of work beside them."""

from sumo_eval.cosim.latency import Latencies


def test_median_and_late_steps_are_those_of_the_case():
    """1 to 100 ms: the middle one of 100 is 51 ms, the hundredth is late, the mean 50.5 ms."""
    times = Latencies(2)
    times.own[0].extend(0.001 * number for number in range(100, 0, -1))
    times.time_fixed_work()
    found, idle = times.of_cases()
    assert [round(1000.0 * value, 9) for value in found[:4]] == [50.5, 100.0, 51.0, 100.0]
    assert 0.0 < found.reference < 1.0
    assert idle[:4] == (0.0, 0.0, 0.0, 0.0)


def test_steps_of_all_rows_are_every_rows_steps():
    times = Latencies(2)
    times.shared.extend([0.5, 0.25])
    assert [row[:2] for row in times.of_cases()] == [(0.375, 0.5)] * 2
