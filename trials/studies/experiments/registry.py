"""All experiments, by identifier: the claims E1 to E12, and comparisons left open."""

from trials.studies.experiments import (
    e01_orientation,
    e02_window,
    e03_slope,
    e04_circle,
    e05_reprojection,
    e06_tracks,
    e07_system,
    e08_few_inliers,
    e09_threshold,
    e10_features,
    e11_standing,
    e12_iterations,
    f02_detectors,
    f09_stereo,
    fxx_ablation,
)
from trials.studies.experiments.experiment import Experiment

EXPERIMENTS: dict[str, Experiment] = {
    module.EXPERIMENT.id: module.EXPERIMENT
    for module in (
        e01_orientation,
        e02_window,
        e03_slope,
        e04_circle,
        e05_reprojection,
        e06_tracks,
        e07_system,
        e08_few_inliers,
        e09_threshold,
        e10_features,
        e11_standing,
        e12_iterations,
        f02_detectors,
        f09_stereo,
        fxx_ablation,
    )
}
