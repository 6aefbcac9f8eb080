"""A setting of the planner, as a word: a preset, and options that differ from it."""

from __future__ import annotations

from packenv.errors import InputError, closest_match
from packenv.planning.options import PRESETS, PlanOptions, Rule, grid_rules, rules


def options_of(setting: str) -> PlanOptions:
    """The options that a setting stands for.

    Args:
        setting: a preset, then options by name: ``paper``, or ``default,grasp=paper,restarts=0``.

    Raises:
        InputError: there is no such preset or option, or a value is wrong.
    """
    preset, *changes = (part.strip() for part in setting.split(","))
    if preset not in PRESETS:
        hint = closest_match(preset, PRESETS, f"; begin with {' or '.join(PRESETS)}")
        raise InputError(f"setting {setting!r:.60}: there is no preset {preset!r:.40}{hint}")
    known = {**rules(), **grid_rules()}
    words = {}
    for change in changes:
        name, equals, text = (part.strip() for part in change.partition("="))
        name = name.replace("-", "_")
        if not equals or name not in known:
            right = "; give option=value, with options as robotpack pack has them"
            hint = right if name in known else closest_match(name, known, right)
            raise InputError(f"setting {setting!r:.60}: {change!r:.40} is no option and its value{hint}")
        words[name] = _value(text, known[name])
    try:
        return PRESETS[preset]().changed(words)
    except InputError as problem:
        raise InputError(f"setting {setting!r:.60}: {problem}") from None


def _value(text: str, rule: Rule) -> object:
    """What a word stands for; the rule itself refuses what is wrong."""
    if rule.words:
        return text
    if text.lower() == "none":
        return None
    try:
        return int(text) if rule.whole else float(text)
    except ValueError:
        return text
