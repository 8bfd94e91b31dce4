"""Stages timed with clocks that the test moves."""

from livehand.backend.research.benchmark.stopwatch import Cost, Spread, Stopwatch, spread


class Clock:
    """Two clocks that move only when the test moves them."""

    def __init__(self):
        self.wall_s, self.core_s, self.waits = 5.0, 2.0, 0

    def advance(self, wall_s, core_s):
        self.wall_s, self.core_s = self.wall_s + wall_s, self.core_s + core_s

    def stopwatch(self):
        return Stopwatch(lambda: self.wall_s, lambda: self.core_s, self.wait)

    def wait(self):
        self.waits += 1
        self.advance(0.25, 0.0)  # the device's remaining work belongs to the stage that queued it


def test_a_stopwatch_sums_stages_in_order_and_waits_for_the_device():
    clock = Clock()
    stopwatch = clock.stopwatch()
    for stage, wall_s, core_s in (("pose", 1, 2), ("field", 2, 3), ("pose", 4, 5)):
        stopwatch.begin(stage)
        clock.advance(wall_s, core_s)
    stages = stopwatch.stop()
    assert list(stages) == ["pose", "field"]
    assert stages == {"pose": Cost(5500, 7), "field": Cost(2250, 3)}
    assert clock.waits == 4
    assert stopwatch.stop() == {}


def test_a_spread_is_median_and_percentiles():
    assert spread([float(k) for k in range(11)]) == Spread(5, 1, 9)
    assert spread([3.0]) == Spread(3, 3, 3)
