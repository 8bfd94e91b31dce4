"""What depends on the progress of training, by steps or by the clock."""

from dataclasses import replace

import pytest
from livehand.backend.training.config import LossConfig, TrainConfig
from livehand.backend.training.schedule import Schedule, perceptual_ramp, view_at, views_of_step


def test_the_rate_rises_then_falls():
    schedule = Schedule(TrainConfig(steps=1000, warmup_steps=10, final_learning_rate=0.02))
    rates = [schedule.at(step).rate_factor for step in range(1000)]
    assert rates[0] == pytest.approx(0.1, rel=0.01)
    assert rates[9] == pytest.approx(1.0, rel=0.01)
    assert max(rates) <= 1
    assert rates[9:] == sorted(rates[9:], reverse=True)
    assert schedule.at(500).rate_factor == pytest.approx(0.02 + 0.98 * 0.5)
    assert schedule.at(1000).rate_factor == pytest.approx(0.02)


def test_with_a_time_budget_everything_follows_the_clock():
    loss = LossConfig(perceptual_share=0.25)
    config = TrainConfig(minutes=10.0, steps=7, final_learning_rate=0.02, warmup_share=0.05, loss=loss)
    schedule = Schedule(config)
    assert (
        schedule.at(3, 300.0).rate_factor == schedule.at(90_000, 300.0).rate_factor == pytest.approx(0.02 + 0.98 * 0.5)
    )
    assert schedule.at(8, 15.0).rate_factor == pytest.approx(0.5, rel=0.01)  # half of the warm-up's 30 s
    assert schedule.at(0, 0.0).rate_factor == pytest.approx(1 / config.warmup_steps)
    assert [schedule.at(50, seconds).perceptual_factor > 0 for seconds in (450.0, 450.1)] == [False, True]
    assert [schedule.is_over(50, seconds) for seconds in (599.9, 600.0, 601.0)] == [False, True, True]
    assert schedule.at(50, 150.0).progress == 0.25
    assert schedule.remaining_s(50, 150.0, 2.0) == 450


def test_without_a_time_budget_everything_follows_the_steps():
    schedule = Schedule(TrainConfig(steps=40, warmup_steps=1))
    assert schedule.at(10, 1e6) == schedule.at(10)
    assert [schedule.is_over(step, 1e6) for step in (39, 40)] == [False, True]
    assert [schedule.at(step).perceptual_factor > 0 for step in (32, 33)] == [False, True]
    assert schedule.remaining_s(10, 1e6, 2.0) == 60


def test_the_perceptual_term_rises_from_zero():
    config = LossConfig(perceptual_share=0.4, perceptual_rise=0.25)
    at = {share: perceptual_ramp(share, config) for share in (0.0, 0.59, 0.61, 0.65, 0.7, 0.75, 1.0)}
    assert list(at.values()) == pytest.approx([0, 0, 0.1, 0.5, 1, 1, 1])
    at_once = replace(config, perceptual_rise=0.0)
    assert [perceptual_ramp(share, at_once) for share in (0.59, 0.6, 0.9)] == [0, 1, 1]
    assert perceptual_ramp(0.9, replace(config, perceptual=0.0)) == 0


@pytest.mark.parametrize("count", [1, 7])
def test_every_epoch_visits_every_view_once_in_an_order_of_its_own(count):
    config = TrainConfig(seed=3, jitter_sets=2)
    epochs = [[view_at(epoch * count + k, count, config) for k in range(count)] for epoch in range(6)]
    for epoch, visits in enumerate(epochs):
        assert sorted(view for view, _ in visits) == list(range(count))
        assert {jitter for _, jitter in visits} == {epoch % 2}
    if count > 1:
        assert len({tuple(view for view, _ in visits) for visits in epochs}) > 3
        assert [view_at(k, count, replace(config, seed=8)) for k in range(count)] != epochs[0]


@pytest.mark.parametrize("batch", [1, 2, 5])
def test_batches_are_parts_of_the_same_sequence(batch):
    config = TrainConfig(seed=3, batch=batch)
    visits = [visit for step in range(12) for visit in views_of_step(step, 7, config)]
    assert visits == [view_at(place, 7, config) for place in range(12 * batch)]
