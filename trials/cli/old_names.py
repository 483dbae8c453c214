"""Earlier names of commands and options, so that an old command line names the new one."""

from collections.abc import Sequence

from vo.contract.errors import SettingsError

OPTIONS = {
    ("gate", "--bless"): "`driftyard gate update`",
    ("gate", "--plan"): "`driftyard gate plan PERCENT`",
    ("drive", "--option"): "`driftyard drive --trial`",
    ("stress", "--most"): "`driftyard stress --max`",
}
"""Command and its earlier option to what replaces it."""
GATE = ("check", "update", "plan", "power")


def refuse_old_names(words: Sequence[str]) -> None:
    """Refuse an earlier command or option.

    Args:
        words: Of the command line, without the program.

    Raises:
        SettingsError: If there is one; names what replaces it.
    """
    command, *rest = words or [""]
    for word in rest:
        name = word.partition("=")[0]
        if (new := OPTIONS.get((command, name))) is not None:
            raise SettingsError(f"`driftyard {command} {name}` is now {new}")
    if command == "gate" and rest and rest[0] not in (*GATE, "--help"):
        raise SettingsError("`driftyard gate` is now `driftyard gate check`")
