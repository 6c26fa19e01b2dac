"""The multi-range study: real sequences and the real estimator, small; that it resumes; what it sums up."""

import json
from contextlib import nullcontext

import numpy as np
import pytest
from range_parts import FRAMES, MACHINE, Flown, sequence

from flightdepth.errors import BadInput
from flightdepth.evaluation import ranges_flight, ranges_study
from flightdepth.evaluation.ranges_claims import FAILS, HOLDS, LEAST_SCENES, OPEN, claims, verdict
from flightdepth.evaluation.ranges_flight import MEASURED_FROM, fly
from flightdepth.evaluation.ranges_peers import FlowNetwork
from flightdepth.evaluation.ranges_result import by_trial, result, shift_figures
from flightdepth.evaluation.ranges_sequences import STEP_S, KeptSequences, Sequences
from flightdepth.evaluation.ranges_study import Study, _refuse_unfit
from flightdepth.evaluation.ranges_trials import (
    CONSTANT,
    DEPTHNET,
    FLOW,
    SWEEPS,
    TINY,
    Telemetry,
    Trial,
    all_trials,
    trial_of,
)
from flightdepth.ranges import RangedDepth
from flightdepth.scenes import Textures
from tests_networks import difference_card

SMALL = Sequences(FRAMES + 3)
TRIALS = (
    Trial(FLOW, 2),
    Trial(FLOW, 1, telemetry=Telemetry(directed=False)),
    Trial(TINY, 0),
    Trial(TINY, 2, "saturation"),
    Trial(CONSTANT, 0),
)


@pytest.fixture(scope="module")
def textures():
    return Textures.procedural(4, 0)


@pytest.fixture(scope="module")
def finished(tmp_path_factory, textures):
    """A study of one short sequence, with a network of the package."""
    study = Study(tmp_path_factory.mktemp("study"), 1, SMALL, trials=TRIALS, textures=textures)
    assert [task.trial for task in study] == list(study.trials)
    return study


# Trials


def test_a_trial_survives_json():
    for trial in all_trials(SWEEPS):
        assert trial_of(json.loads(json.dumps(trial.facts))) == trial


def test_every_trial_stands_once():
    everything = all_trials(SWEEPS)
    assert len(set(everything)) == len(everything)
    assert set(all_trials()) < set(all_trials(SWEEPS, quick=True)) < set(everything)


@pytest.mark.parametrize("name", SWEEPS)
def test_every_sweep_adds_to_the_figure_and_quick_keeps_some_of_it(name):
    assert set(all_trials()) < set(all_trials([name], quick=True)) <= set(all_trials([name]))


def test_sweeps_vary_what_they_say():
    told = {name: {trial.telemetry for trial in sweep()} for name, sweep in SWEEPS.items()}
    assert {log.rate_hz for log in told["telemetry"]} == {5, 10, 20, 50}
    assert {log.bias for log in told["speed"]} == {-0.2, -0.1, 0.0, 0.1, 0.2}
    assert {trial.noise_rad for trial in SWEEPS["noise"]()} >= {0.0, 0.001, 0.01}
    assert {trial.ranges for trial in SWEEPS["ranges"]()} == {1, 2, 3, 4, 5, 6}
    assert {trial.ranges for trial in SWEEPS["shift"]()} == {0}
    assert {trial.ranges for trial in SWEEPS["fusion"]() if trial.derotate} == {1, 2, 3, 4}


def test_the_papers_figure_is_whole():
    shown = {(trial.method, trial.ranges) for trial in all_trials(quick=True) if trial.noise_rad == 0.001}
    depthnet = {(DEPTHNET, 1), (DEPTHNET, 2)}
    assert depthnet | {("clamped-256", n) for n in (1, 2, 3)} | {(TINY, n) for n in (1, 2, 3, 4)} <= shown


def test_a_digest_changes_with_all_that_matters():
    trial = Trial(TINY, 2)
    others = [Trial(TINY, 3), Trial(TINY, 2, "saturation"), Trial(TINY, 2, telemetry=Telemetry(bias=0.1))]
    digests = {each.digest({"frames": 40}) for each in (trial, *others)} | {trial.digest({"frames": 41})}
    assert len(digests) == 5


# Sequences


def test_noise_turns_the_pictures_and_leaves_the_path(textures):
    tiny = Sequences(FRAMES, width=64)
    steady, noisy = (tiny.render(3, noise, textures) for noise in (0.0, 0.01))
    np.testing.assert_array_equal(steady.velocity, noisy.velocity)
    assert (steady.images != noisy.images).mean() > 0.2
    np.testing.assert_allclose(np.median(noisy.truth_m / steady.truth_m), 1, atol=0.02)


def test_a_sequence_flies_a_metre_a_second_at_thirty_frames(textures):
    flown = Sequences(FRAMES, width=64).render(3, 0.0, textures)
    np.testing.assert_allclose(np.linalg.norm(flown.velocity, axis=1), 1.0)
    assert np.diff(flown.stamps_ns).tolist() == [round(STEP_S * 1e9)] * (FRAMES - 1)
    assert flown.truth_m.shape == (FRAMES, 16, 16)


# The study


def test_every_part_has_figures(finished):
    for part in finished.parts():
        assert 0 < part["errors"]["all"]["abs_rel"] < 5
        assert part["flicker"] >= 0
        if part["trial"]["method"] != CONSTANT:
            assert part["whole_ms"] > part["predict_ms"] > 0


def test_a_fixed_shift_is_fixed_and_clusters_move(finished):
    parts = by_trial(finished.parts())
    nominal = round(0.5 / STEP_S)  # D0 of tiny-clamped-256 at 1 m/s
    assert {tuple(frame) for frame in parts[Trial(TINY, 0)][0]["shifts"]} == {(nominal,)}
    assert len({tuple(frame) for frame in parts[Trial(FLOW, 2)][0]["shifts"]}) > 1


def test_the_papers_fusion_leaves_nothing_out_and_the_default_does(finished):
    known = {trial: parts[0]["errors"]["all"]["known"] for trial, parts in by_trial(finished.parts()).items()}
    assert known[Trial(FLOW, 2)] == 1
    assert known[Trial(TINY, 2, "saturation")] < 1


def test_flow_sees_depth_where_a_constant_does_not(finished):
    errors = {t: parts[0]["errors"]["all"]["abs_rel"] for t, parts in by_trial(finished.parts()).items()}
    assert errors[Trial(FLOW, 2)] < 1.5 * errors[Trial(CONSTANT, 0)]


def test_errors_are_split_by_what_the_pairs_could_see(finished):
    for trial, (part,) in by_trial(finished.parts()).items():
        if trial.method == CONSTANT:
            assert part["coverage"] is None
            continue
        pixels, known, error = np.array(part["coverage"]).sum(axis=0)
        assert error / known == pytest.approx(part["errors"]["all"]["abs_rel"])
        assert pixels == part["errors"]["all"]["pixels"]


def test_the_best_range_in_hindsight_is_no_worse_than_their_fusion(finished):
    part = by_trial(finished.parts())[Trial(FLOW, 2)][0]
    assert part["best_abs_rel"]["all"] < part["errors"]["all"]["abs_rel"]


def test_a_sequence_is_rendered_once_for_all_trials(finished):
    (kept,) = (finished.folder / "sequences").iterdir()
    assert kept.stat().st_size > SMALL.frames * 256 * 256 * 3


def test_pictures_come_back_from_the_disk_as_they_were(tmp_path, textures):
    tiny = Sequences(FRAMES, width=64)
    rendered = tiny.render(2, 0.001, textures)
    for _ in range(2):
        kept = KeptSequences(tmp_path, tiny, lambda: textures, textures.digest).get(2, 0.001)
        np.testing.assert_array_equal(kept.images, rendered.images)
        np.testing.assert_array_equal(kept.truth_m, rendered.truth_m)
        np.testing.assert_array_equal(kept.velocity, rendered.velocity)
        np.testing.assert_array_equal(kept.stamps_ns, rendered.stamps_ns)
        assert kept.camera == rendered.camera


def test_other_noise_or_textures_are_other_pictures(tmp_path, textures):
    tiny = Sequences(FRAMES, width=64)
    plain = KeptSequences(tmp_path, tiny, lambda: textures, "")
    others = [KeptSequences(tmp_path, Sequences(FRAMES), lambda: textures, ""), plain]
    paths = {plain.path(0, 0.001), plain.path(1, 0.001), others[0].path(0, 0.001), others[1].path(0, 0.002)}
    paths.add(KeptSequences(tmp_path, tiny, lambda: textures, "x").path(0, 0.001))
    assert len(paths) == 5


def test_nothing_is_left_of_a_finished_study(finished):
    assert finished.left() == (0, 0)


def test_what_is_left_is_counted(finished, textures):
    more = Study(finished.folder, 2, SMALL, trials=(*TRIALS[:1], Trial(FLOW, 4)), textures=textures)
    assert more.left() == (3, 1)  # the second scene of the one, both scenes of the other


def test_more_ranges_than_the_papers_system_has(textures):
    sequence = Sequences(FRAMES + 3, width=64).render(0, 0.001, textures)
    part = fly(Trial(FLOW, 6), FlowNetwork(sequence.camera.fx), sequence)
    assert max(len(frame) for frame in part["shifts"]) > 4


def test_a_finished_study_is_not_done_again(finished):
    before = {task.path: task.path.stat().st_mtime_ns for task in finished.tasks}
    list(finished)
    assert before == {task.path: task.path.stat().st_mtime_ns for task in finished.tasks}


def test_a_stopped_study_goes_on(finished, textures):
    lost = finished.tasks[-1].path
    kept = json.loads(lost.read_text())
    lost.unlink()
    list(Study(finished.folder, 1, SMALL, trials=TRIALS, textures=textures))
    again = json.loads(lost.read_text())
    assert again["errors"] == kept["errors"]


def test_other_frames_are_another_study(finished, textures):
    other = Study(finished.folder, 1, Sequences(FRAMES), trials=TRIALS, textures=textures)
    assert not {task.path for task in other.tasks} & {task.path for task in finished.tasks}


@pytest.mark.parametrize(("name", "other"), [("__version__", "another"), ("MEASURED_FROM", 30)])
def test_what_other_code_measured_is_measured_anew_on_the_same_pictures(
    finished, textures, monkeypatch, name, other
):
    """A study went on beside the figures of older code, without a word."""
    monkeypatch.setattr(ranges_study, name, other)
    again = Study(finished.folder, 1, SMALL, trials=TRIALS, textures=textures)
    assert again.left() == (len(TRIALS), 0)


def test_a_network_whose_maps_are_of_another_size_is_refused(tmp_path):
    """Every frame counted as one without depth: `tiny-clamped-512` sees 128 px of focal length at 256."""
    with pytest.raises(BadInput, match=r"tiny-clamped-512: .* 128 px .*, got one that sees them at 256 px"):
        Study(tmp_path, 1, SMALL, trials=(Trial("tiny-clamped-512", 1),))


@pytest.mark.parametrize(("seen_px", "fits"), [(64.0, False), (128.0, True), (256.0, True)])
def test_a_network_for_any_lens_flies_where_it_sees_every_pixel(seen_px, fits):
    card = difference_card(architecture="MotionNet", any_lens=True, focal_px=seen_px)
    with nullcontext() if fits else pytest.raises(BadInput, match="at 64 px"):
        _refuse_unfit("mine", card, SMALL.focal_px)


def test_a_frame_without_depth_is_one_that_says_so(monkeypatch):
    """It was told by the size of its map, which another network's has as well."""

    class Speechless:
        def add_velocity(self, *_, **__):
            pass

        def add_frame(self, *_):
            return RangedDepth.unknown(16, 16, "nothing flown", 0.0)

    monkeypatch.setattr(ranges_flight, "_estimator", lambda *_: Speechless())
    flown = sequence()
    part = fly(Trial(FLOW, 1), FlowNetwork(flown.camera.fx), flown)
    assert (part["without_depth"], part["shifts"]) == (FRAMES - MEASURED_FROM, [])
    assert part["errors"]["all"]["known"] == 0


def test_a_network_that_is_not_there_is_named(tmp_path):
    study = Study(tmp_path, 1, SMALL, trials=(Trial("a network to come", 1), Trial(FLOW, 1)))
    assert study.missing == ("a network to come",)
    assert study.trials == (Trial(FLOW, 1),)


@pytest.mark.parametrize(("scenes", "frames"), [(0, 60), (1, 20)])
def test_too_little_is_refused(tmp_path, scenes, frames):
    with pytest.raises(BadInput, match="expected at least"):
        Study(tmp_path, scenes, Sequences(frames), trials=TRIALS)


# What is summed up


def test_a_figure_is_the_factor_that_depth_was_off_by():
    trial = Trial(DEPTHNET, 2)
    found = result(Flown({trial: 1.3}))
    rows = {trial_of(row["trial"]): row for row in found["trials"]}
    assert rows[trial]["errors"]["all"]["abs_rel"]["mean"] == pytest.approx(0.3, abs=1e-5)
    assert rows[trial]["errors"]["far"]["abs_rel"]["scenes"] == 2
    assert rows[trial]["flicker"]["mean"] == 0
    assert rows[trial]["confidence"]["signed_error"] == pytest.approx(0.85)
    assert found["about"]["missing_networks"] == ["clamped-256"]
    json.dumps(found, allow_nan=False)


def test_a_study_that_went_on_elsewhere_names_both_machines():
    trial, study = Trial(DEPTHNET, 2), Flown({Trial(DEPTHNET, 2): 1.3})
    here, there = study.parts()
    study.parts = lambda: [here | {"runtime": "bf16"}, there | {"runtime": "f32", "machine": "another"}]
    found = result(study)
    assert found["about"]["runtimes"] == {trial.method: "bf16, f32"}
    assert found["about"]["machine"] == found["trials"][0]["machine"] == f"{MACHINE}, another"


def test_claims_follow_the_errors():
    one, two, tiny = Trial(DEPTHNET, 1), Trial(DEPTHNET, 2), Trial(TINY, 4)
    found = claims(by_trial(Flown({one: 1.3, two: 1.1, tiny: 1.4}, scenes=LEAST_SCENES).parts()))
    verdicts = {(row["better"], row["worse"]): row for row in found if row["span"] == "all"}
    assert verdicts[two.label, one.label]["verdict"] == HOLDS
    assert verdicts[two.label, one.label]["ratio"] == pytest.approx(1 / 3, rel=1e-4)
    assert verdicts[tiny.label, one.label]["verdict"] == FAILS
    assert verdicts[tiny.label, one.label]["scenes_better"] == 0


@pytest.mark.parametrize(
    ("low", "high", "said"), [(-2, -1, HOLDS), (1, 2, FAILS), (-1, 1, OPEN), (0, 0, OPEN)]
)
def test_an_interval_across_nothing_decides_nothing(low, high, said):
    assert verdict(low, high, LEAST_SCENES) == said


def test_few_scenes_decide_nothing_however_they_agree():
    assert verdict(-2, -1, LEAST_SCENES - 1) == OPEN


def test_ranges_that_chose_one_frame_are_counted():
    found = shift_figures([[3, 9], [3, 9], [5], [2, 4, 8]], 2)
    assert found["coincide"] == 0.25
    assert found["quartiles"] == [[3, 3, 3], [9, 9, 9]]
