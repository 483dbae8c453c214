"""Errors with a cause in the input, each a single line that says what to do."""


class DriftyardError(Exception):
    """Base of all errors caused by input; the command line prints it and exits with status 2.

    Example:
        >>> try:
        ...     dy.open("nowhere")
        ... except dy.DriftyardError as error:
        ...     print(error)
        nowhere: no such folder
    """


class DatasetError(DriftyardError):
    """A dataset, an image or a table that is missing, unreadable or inconsistent."""


class ImageError(DatasetError):
    """An image that is missing, damaged or of another size; it costs its frame, not the run."""


class FrameIndexError(DatasetError, IndexError):
    """An index of a frame that a recording does not have."""


class CalibrationError(DriftyardError):
    """A camera or rig calibration that does not describe a stereo pair."""


class SettingsError(DriftyardError):
    """An unknown setting, scene or choice, or a value out of range."""


class TrajectoryError(DriftyardError):
    """A malformed trajectory file, or two trajectories that cannot be compared."""
