"""F: what each idea that the thesis proposes or cites is worth, one by one."""

from collections.abc import Sequence

from trials.execution.jobs import Job, Results, Variant, jobs_of
from trials.studies.experiments.compare import (
    comparison_data,
    comparison_table,
    draw_ratios,
    ratios,
)
from trials.studies.experiments.experiment import Experiment, Findings, Scale, Verdict
from trials.studies.experiments.variants import DEFAULT, THESIS

SCENES = ("office", "brick_court", "corridor", "crowded", "turntable")


def _changed(label: str, *overrides: str) -> Variant:
    return Variant(label, "driftyard", overrides)


OTHERS = (
    _changed("F1 never starting anew", "patience_frames=1000000"),
    _changed("F2 Harris corners", "features.detector=harris"),
    _changed("F4 triplets of frames", "matching.circular_check=true"),
    _changed("F5 without guided matching", "matching.guided=false"),
    _changed("F6 rotation from far points", "motion.method=decoupled"),
    _changed("F6 without points beyond 5 m", "stereo.min_disparity_px=8"),
    _changed("F7 firewall", "refinement.map_reset_keyframes=8"),
    _changed("F7 preemptive RANSAC", "motion.scheme=preemptive"),
    _changed("F8 no motion before refinement", "motion.method=graduated_nonconvexity"),
    _changed("trust in what was at rest", "motion.landmark_prior=true"),
    _changed("F9 block matching", "stereo.method=block_matching", "stereo.downscale=1"),
    _changed("F9 semi-global stereo", "stereo.method=semi_global", "stereo.downscale=1"),
    _changed(
        "F10 one noise for all",
        "refinement.sigma_px=0.5",
        "refinement.sigma_disparity_px=0.5",
        "refinement.learn_noise=false",
    ),
    _changed("F13 dropping slow frames", "refinement.max_keyframe_iterations=20"),
    _changed("no refinement of structure", "refinement.mode=motion"),
    _changed("no alignment of matches", "matching.align=false", "matching.guided=false"),
    THESIS,
)


def jobs(scale: Scale) -> Sequence[Job]:
    """The default settings, and the same with one thing changed."""
    return jobs_of(scale.recordings(SCENES, 3), (DEFAULT, *OTHERS))


def analyse(results: Results) -> Findings:
    """Order the changes by what they cost."""
    found = ratios(results, OTHERS, DEFAULT)
    costly = sorted((v for v in OTHERS if found[v].low > 1), key=lambda v: -found[v].value)
    gains = [v for v in OTHERS if found[v].high < 1]
    named = ", ".join(f"{v.label} {found[v].value:.2f}" for v in costly[:5])
    better = ", ".join(f"{v.label} {found[v].value:.2f}" for v in gains)
    return Findings(
        Verdict.HOLDS if costly and not gains else Verdict.PARTLY,
        (f"What costs most (times the drift of the default settings): {named}. " if named else "")
        + (f"Better than the default: {better}." if better else "No change is clearly better."),
        comparison_table(results, OTHERS, DEFAULT, "changed"),
        "Drift with one thing changed over that of the default settings: diamonds are geometric "
        "means, bars their 95 % intervals, dots drives.",
        lambda figure: draw_ratios(figure, results, OTHERS, DEFAULT),
        {"drift": comparison_data(results, OTHERS, DEFAULT)},
    )


EXPERIMENT = Experiment(
    id="F",
    title="What each idea is worth",
    claim="Each idea that the default settings contain lowers the drift, and none that they leave "
    "out would.",
    source="sections 2.2, 5 and 6; items F1 to F13",
    setup="The default settings with one thing changed, on five scenes, and the thesis preset. F3, "
    "a reference to compare with, is the truth itself.",
    size_in=(8.5, 5.2),
    jobs=jobs,
    analyse=analyse,
)
