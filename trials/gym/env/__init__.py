"""The Gymnasium environments: observations, actions, tasks and localization."""

from sim.graphics import check_variables

check_variables()  # MuJoCo reads them when it is imported, and its errors name no variable
