import numpy as np
import pytest
from range_oracle import CLAMPED, card

from flightdepth.ranges.fusion import Fused
from flightdepth.ranges.plan import FARTHEST_M, MAX_PICTURE_SHIFT, SCOUT_EVERY_S, Planner

S = 1_000_000_000
ALL = np.ones((32, 32), dtype=np.bool_)
USABLE = np.array([0.1, 0.4, 1.6, 6.4])


def planner(ranges: int = 2, *, saturation: bool = True) -> Planner:
    return Planner(CLAMPED, ranges, sides=2.0, memory_s=4.0, saturation=saturation)


def fused(known: float, *, farther: float = np.nan, nearer: float = np.nan, share: float = 0.5) -> Fused:
    """The lower `share` of the picture at depth `known`, the rest unknown with the given bounds."""
    upper = np.arange(32)[:, None] < round(32 * (1 - share))
    maps = [np.where(upper, value, np.nan) for value in (farther, nearer)]
    depth = np.where(upper, np.nan, known)
    full = [np.broadcast_to(m, (32, 32)).astype(np.float32) for m in (depth, depth, *maps)]
    return Fused(full[0], np.nan_to_num(full[1]), full[2], full[3], None)


def test_start_up_spreads_in_equal_ratios_inside_what_there_is() -> None:
    wanted, depths = planner(2).wanted(0, USABLE)
    np.testing.assert_allclose(wanted, [0.4, 1.6])
    assert np.isnan(depths).all()


def test_start_up_with_one_displacement_takes_it() -> None:
    np.testing.assert_allclose(planner(3).wanted(0, np.array([0.2]))[0], [0.2] * 3)


def test_a_learned_depth_chooses_the_displacement() -> None:
    plan = planner(1)
    plan.learn(0, fused(24.0, share=1.0), ALL)
    wanted, depths = plan.wanted(1, USABLE)
    np.testing.assert_allclose(wanted, [0.5])
    np.testing.assert_allclose(depths, [24.0])


def test_what_is_measured_far_beyond_use_asks_for_no_longer_pairs() -> None:
    """A drifting cloud at 5 km; the paper's estimator follows it."""
    for saturation, expected_m in ((True, FARTHEST_M), (False, 5000.0)):
        plan = planner(1, saturation=saturation)
        plan.learn(0, fused(5000.0, share=1.0), ALL)
        np.testing.assert_allclose(plan.wanted(1, USABLE)[1], [expected_m], rtol=1e-5)


def test_an_old_depth_is_forgotten() -> None:
    plan = planner(1)
    plan.learn(0, fused(24.0, share=1.0), ALL)
    assert np.isnan(plan.wanted(5 * S, USABLE)[1]).all()


def test_a_depth_counts_as_long_as_the_memory_and_its_bounds_as_long_as_it() -> None:
    plan = planner(1)
    plan.learn(0, fused(24.0, farther=54.0), ALL)
    np.testing.assert_allclose(plan.wanted(4 * S, USABLE)[1], [24, 54])
    assert np.isnan(plan.wanted(4 * S + S // 2, USABLE)[1]).tolist() == [True]  # no scout is sent either


def test_too_few_measured_pixels_start_over() -> None:
    plan = planner(1)
    plan.learn(0, fused(24.0, share=0.0), ALL)
    assert np.isnan(plan.wanted(1, USABLE)[1]).all()


def test_padding_is_left_out() -> None:
    plan = planner(1)
    shown = np.zeros((32, 32), dtype=np.bool_)
    shown[31] = True
    maps = fused(24.0, share=1.0)
    maps.depth_m[:31] = 500.0
    plan.learn(0, maps, shown)
    np.testing.assert_allclose(plan.wanted(1, USABLE)[1], [24.0])


def test_displacements_are_bounded_by_the_near_part_of_the_picture() -> None:
    plan = Planner(card(), 2, sides=2.0, memory_s=4.0, saturation=False)
    maps = fused(3.0, share=0.5)
    maps.depth_m[:16] = 5000.0
    plan.learn(0, maps, ALL)
    np.testing.assert_allclose(plan.wanted(1, USABLE)[0].max(), MAX_PICTURE_SHIFT * 2.0 * 3.0)


def test_through_a_lens_that_zoomed_a_displacement_moves_the_picture_further() -> None:
    """The plan kept the lens that it began with: twice the focal length, and half the displacement is enough."""
    plan = Planner(card(), 2, sides=2.0, memory_s=4.0, saturation=False)
    maps = fused(3.0, share=0.5)
    maps.depth_m[:16] = 5000.0
    plan.learn(0, maps, ALL)
    plan.look_through(card(), 1.0)
    for stamp_ns in (1, 2):
        np.testing.assert_allclose(plan.wanted(stamp_ns, USABLE)[0].max(), MAX_PICTURE_SHIFT * 1.0 * 3.0)
        plan.learn(stamp_ns, maps, ALL)


def test_what_is_nearer_than_was_seen_bounds_displacements_too() -> None:
    """Half of the picture is at most 9 m away; the rest asks for 300 m."""
    plan = planner(1)
    plan.learn(0, fused(1000.0, nearer=9.0), ALL)
    np.testing.assert_allclose(plan.wanted(1, USABLE)[0][0], MAX_PICTURE_SHIFT * 2.0 * 9.0)


def test_what_lies_between_two_ranges_sends_no_scout() -> None:
    plan = planner(1)
    plan.learn(0, fused(24.0, farther=54.0, nearer=112.0), ALL)
    assert len(plan.wanted(1, USABLE)[0]) == 1


def test_scouts_start_over_where_no_longer_displacement_is_allowed() -> None:
    """A near ground, at 3 m, allows 1.5 m; 121.5 m wants 2.5."""
    plan, looked = planner(1), []
    for k in range(4):
        plan.learn(k * S, fused(3.0, farther=54.0), ALL)
        looked.append(plan.wanted(k * S + 1, USABLE)[1][-1])
        plan.learn(k * S + 2, fused(3.0, farther=2.25 * looked[-1]), ALL)
    np.testing.assert_allclose(looked, [54, 121.5, 54, 121.5])


def test_a_sky_sends_a_scout_beyond_its_bound() -> None:
    plan = planner(1)
    plan.learn(0, fused(24.0, farther=54.0), ALL)
    wanted, depths = plan.wanted(1, USABLE)
    np.testing.assert_allclose(depths, [24, 54])
    np.testing.assert_allclose(wanted, [0.5, 1.125])


def test_something_too_near_sends_a_scout_closer() -> None:
    plan = planner(1)
    plan.learn(0, fused(24.0, nearer=9.0), ALL)
    np.testing.assert_allclose(plan.wanted(1, USABLE)[1], [24, 4])


def test_scouts_rest() -> None:
    plan = planner(1)
    counts = []
    for k in range(30):
        plan.learn(k * S // 30, fused(24.0, farther=54.0), ALL)
        counts.append(len(plan.wanted(k * S // 30 + 1, USABLE)[0]))
    assert sum(counts) - 30 == round(1 / SCOUT_EVERY_S)


def test_the_papers_fusion_sends_no_scouts() -> None:
    plan = planner(1, saturation=False)
    plan.learn(0, fused(24.0, farther=54.0), ALL)
    assert len(plan.wanted(1, USABLE)[0]) == 1


@pytest.mark.parametrize(
    ("bound", "step", "expected"),
    [
        ("farther", 2.25, [54, 121.5, 273.375, 54, 121.5]),  # 273 m wants 5.7 m, more than there is
        ("nearer", 0.2, [24, 4.8, 0.96, 24, 4.8]),  # 0.96 m wants 0.02 m, less than there is
    ],
)
def test_fruitless_scouts_go_on_then_start_over(bound: str, step: float, expected: list[float]) -> None:
    plan = planner(1)
    looked = []
    for k in range(len(expected)):
        plan.learn(k * S, fused(100.0, **{bound: 54.0}), ALL)
        looked.append(plan.wanted(k * S + 1, np.array([0.09, 3.0]))[1][-1])
        reached = step * looked[-1] * (2.25 if bound == "nearer" else 1)
        plan.learn(k * S + 2, fused(100.0, **{bound: reached}), ALL)
    np.testing.assert_allclose(looked, expected)


def in_turn() -> Planner:
    return Planner(CLAMPED, 1, sides=2.0, memory_s=4.0, saturation=True, turns=2)


def test_one_range_looks_near_and_far_in_turn() -> None:
    plan, seen = in_turn(), []
    # Each look knows its own half of the picture only: 8 m below, or 64 m above.
    near, far = fused(8.0), fused(8.0)
    far.depth_m[:] = np.where(np.isnan(near.depth_m), np.float32(64), np.float32(np.nan))
    plan.learn(0, near, ALL)
    for i, maps in enumerate((far, near, far, near)):
        plan.learn(i + 1, maps, ALL)
        wanted, depths = plan.wanted(i + 1, USABLE)
        assert len(wanted) == 1
        seen.append(float(depths[0]))
    assert seen[:2] == pytest.approx(seen[2:], rel=1e-3)
    assert sorted(seen[:2]) == pytest.approx([8.0, 64.0], rel=1e-3)


def test_depth_through_another_lens_is_not_looked_at_in_turn() -> None:
    """After a zoom it lies at other pixels, where it hid what the new picture shows."""
    plan = in_turn()
    plan.learn(0, fused(8.0), ALL)
    plan.look_through(CLAMPED, 1.0)
    plan.learn(1, fused(64.0), ALL)
    assert float(plan.wanted(1, USABLE)[1][0]) == pytest.approx(64.0, rel=1e-3)


@pytest.mark.parametrize("bound", [{"farther": 54.0}, {"nearer": 18.0}])
def test_what_the_look_before_knew_needs_no_scout(bound: dict[str, float]) -> None:
    plan = in_turn()
    plan.learn(0, fused(8.0, share=1.0), ALL)
    plan.learn(1, fused(64.0, **bound), ALL)
    assert len(plan.wanted(2, USABLE)[0]) == 1
    plan.learn(3, fused(64.0, **bound), ALL)  # but one look before the last does not count
    assert len(plan.wanted(4, USABLE)[0]) == 2


def other_half(known: float) -> Fused:
    """The upper half of the picture at depth `known`."""
    maps = fused(known)
    maps.depth_m[:] = maps.depth_m[::-1].copy()
    return maps


@pytest.mark.parametrize(("turns", "ranges"), [(1, 1), (1, 2), (2, 2)])
def test_without_turns_a_depth_is_of_its_own_frame(turns: int, ranges: int) -> None:
    plan = Planner(CLAMPED, ranges, sides=2.0, memory_s=4.0, saturation=True, turns=turns)
    plan.learn(0, fused(8.0), ALL)
    plan.learn(1, other_half(64.0), ALL)
    np.testing.assert_allclose(plan.wanted(2, USABLE)[1], [64.0] * ranges, rtol=1e-3)


def test_a_depth_that_is_forgotten_completes_no_later_one() -> None:
    plan = in_turn()
    plan.learn(0, fused(8.0), ALL)
    assert np.isnan(plan.wanted(5 * S, USABLE)[1]).all()
    plan.learn(5 * S, other_half(64.0), ALL)
    looked = [float(plan.wanted(5 * S + k, USABLE)[1][0]) for k in (1, 2)]
    assert looked == pytest.approx([64.0, 64.0], rel=1e-3)


def test_several_ranges_take_no_turns() -> None:
    plan = in_turn()
    plan.ranges = 2
    maps = fused(8.0)
    maps.depth_m[np.isnan(maps.depth_m)] = 64.0
    plan.learn(0, maps, ALL)
    np.testing.assert_allclose(plan.wanted(1, USABLE)[1], [8.0, 64.0], rtol=1e-3)


def test_near_and_far_scouts_go_out_in_turn() -> None:
    plan, looked = planner(1), []
    maps = fused(24.0, farther=54.0)
    maps.farther_than_m[8:16], maps.nearer_than_m[8:16] = np.nan, 18.0
    for k in range(4):
        plan.learn(k * S, maps, ALL)
        looked.append(plan.wanted(k * S + 1, USABLE)[1][-1])
    np.testing.assert_allclose(looked, [8, 54, 8, 54])


def test_another_number_of_ranges_counts_from_the_next_depth_on() -> None:
    """Half of the picture at 8 m, a quarter at 24 and at 64 each."""
    plan, maps, counts = planner(3), fused(8.0), []
    maps.depth_m[:8], maps.depth_m[8:16] = 64.0, 24.0
    plan.learn(0, maps, ALL)
    for k, ranges in enumerate((2, 1, 4), start=1):
        plan.ranges = ranges
        before = len(plan.wanted(k, USABLE)[1])
        plan.learn(k, maps, ALL)
        counts.append((before, len(plan.wanted(k, USABLE)[1])))
    assert counts == [(3, 2), (1, 1), (1, 4)]
