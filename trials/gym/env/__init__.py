"""The Gymnasium environments: observations, actions, tasks and localization."""
