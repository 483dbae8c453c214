"""All experiments by identifier: claims E1 to E12 of the thesis, and open comparisons."""

from trials.studies.experiments.adjustment import E2, E12
from trials.studies.experiments.base import Experiment
from trials.studies.experiments.comparisons import F2, F
from trials.studies.experiments.drives import E3, E4, E7
from trials.studies.experiments.e06_tracks import E6
from trials.studies.experiments.e11_stationary import E11
from trials.studies.experiments.orientation import E1, F9
from trials.studies.experiments.sweeps import E9, E10
from trials.studies.experiments.turns import E5, E8

EXPERIMENTS: dict[str, Experiment] = {
    x.id: x for x in (E1, E2, E3, E4, E5, E6, E7, E8, E9, E10, E11, E12, F2, F9, F)
}
