"""The values of a sweep: the options that state them, and the settings of the campaign of each value.

A value is written as in a campaign file; quotes around a text may be left out. Commas separate values, except within
brackets or quotes: a list has brackets.
"""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from analysis.errors_and_files import digest, shown
from campaign.config import Config, ConfigError, parse_config

#: Values of one sweep.
MOST_VALUES = 1000
_BARE = re.compile(r"[A-Za-z0-9_-]+")
#: A text in quotes, a bracket, a comma, or a piece of anything else.
_PIECES = re.compile(r"\"(?:\\.|[^\"\\])*\"|'[^']*'|[\[\]{},]|[^\"'\[\]{},]+|.", re.DOTALL)


@dataclass(frozen=True)
class Variant:
    """The campaign of one value of the key: the value in words, the name of its folder, and its settings."""

    value: str
    folder: str
    config: Config


def variants(config: Config, swept: Sequence[str], along: Sequence[str] = ()) -> tuple[str, list[Variant]]:
    """Return the key and one campaign per value, in the order that is given.

    swept: the option `--set` as "key=value,value,...", exactly once. along: the options `--with`, keys that change
    together with the first one, each with as many values. Raises ConfigError with one line for an option that cannot be
    read, an unknown key, a value out of range, fewer than two values, or the same value twice.
    """
    if not swept:
        raise ConfigError("a sweep needs --set and a key with its values: --set consolidation.sigma_3_kPa=50,100,200")
    if len(swept) > 1:
        raise ConfigError(
            f"--set is given {len(swept)} times: a sweep has one key, no grid; "
            "a second key that changes together with it is given by --with"
        )
    if config.run.engine == "slurm":
        raise ConfigError(
            "a sweep runs on this machine; for SLURM, `run --engine slurm` submits the campaign of each value"
        )
    key, values = _option("--set", swept[0])
    others = [_option("--with", text) for text in along]
    if len(values) < 2:
        raise ConfigError(
            f"--set {key}: only {_words(values[0])} is given, a sweep needs at least two values, separated by commas"
        )
    if len(values) > MOST_VALUES:
        raise ConfigError(f"--set {key}: has {len(values):,} values, at most {MOST_VALUES:,}")
    for k, value in enumerate(values):
        if value in values[:k]:
            raise ConfigError(f"--set {key}: the value {_words(value)} is given twice")
    names = [key, *(name for name, _ in others)]
    for k, (name, list_of_values) in enumerate(others, 1):
        if name in names[:k]:
            raise ConfigError(f"--with {name}: the key is given twice")
        if len(list_of_values) != len(values):
            raise ConfigError(
                f"--with {name}: number of values: {len(list_of_values)}, and {len(values)} of --set {key}"
            )
    table = tomllib.loads(config.text)
    folders = _folders(key, values)
    return key, [
        Variant(_words(value), folder, _with(config, table, dict(zip(names, row, strict=True)), folder))
        for value, folder, row in zip(values, folders, zip(values, *(o for _, o in others), strict=True), strict=True)
    ]


def _option(option: str, text: str) -> tuple[str, list[Any]]:
    """Key and values of "key=value,value"."""
    key, equals, rest = text.partition("=")
    key = key.strip()
    if not equals or not all(_BARE.fullmatch(part) for part in key.split(".")):
        raise ConfigError(
            f"{option} {shown(text)}: must be a key and its values, such as consolidation.sigma_3_kPa=50,100,200"
        )
    if key == "name" or key.split(".")[0] == "run":
        raise ConfigError(f"{option} {key}: this key does not change a result")
    return key, [_value(f"{option} {key}", part) for part in _split(f"{option} {key}", rest)]


def _split(where: str, text: str) -> list[str]:
    """Parts between the commas that are in no bracket and in no quotes."""
    parts, depth = [""], 0
    for piece in _PIECES.findall(text):
        depth += (piece in ("[", "{")) - (piece in ("]", "}"))
        if piece == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += piece
        if depth < 0:
            break
    if depth:
        raise ConfigError(f"{where}: {shown(text)} has a bracket without its partner")
    return [part.strip() for part in parts]


def _value(where: str, text: str) -> Any:
    """A value of a campaign file; what is no value there is a text without its quotes."""
    if not text:
        raise ConfigError(f"{where}: a value is empty; an empty text is written as ''")
    try:
        table = tomllib.loads(f"value = {text}")
    except (tomllib.TOMLDecodeError, ValueError, RecursionError):
        if text[0] in "[{\"'" or not text.isprintable():
            raise ConfigError(f"{where}: {shown(text)} is no value of a campaign file") from None
        return text
    if table.keys() != {"value"}:
        raise ConfigError(f"{where}: {shown(text)} is no value of a campaign file")
    return table["value"]


def _words(value: Any) -> str:
    """A value in words: numbers in full, texts without quotes, lists in brackets."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(_words, value))}]"
    return f"{value:.15g}" if isinstance(value, float) else str(value)


def _folders(key: str, values: Sequence[Any]) -> list[str]:
    """A folder's name for each value; a hash tells those apart that would have the same."""
    names = []
    for value in values:
        words = Path(value).stem if isinstance(value, str) else _words(value).strip("[]")
        name = re.sub(r"[^\w.+-]+", "_", words, flags=re.ASCII)[:60] or "empty"
        names.append(f"{key}={name}")
    return [
        f"{name}_{digest(_words(value).encode(), 6)}" if names.count(name) > 1 or len(name) > len(key) + 60 else name
        for name, value in zip(names, values, strict=True)
    ]


def _with(config: Config, table: Mapping[str, Any], changed: Mapping[str, Any], folder: str) -> Config:
    """The settings of a campaign file with some keys changed; the places of its other files stay the same."""
    new = copy.deepcopy(dict(table))
    for key, value in changed.items():
        *sections, last = key.split(".")
        place: dict[str, Any] = new
        for section in sections:
            place = place.setdefault(section, {})
            if not isinstance(place, dict):
                raise ConfigError(f"{config.source.name}: unknown key {key}: {section} is no section")
        place[last] = value
    swept, _, word = folder.partition("=")
    new["name"] = re.sub(r"[^A-Za-z0-9_.-]+", "_", f"{config.name}_{swept.rpartition('.')[2]}_{word}")[:61]
    text = f"# Made by a sweep of {swept} from {config.source.name}\n\n{toml_text(new)}"
    return replace(parse_config(text, config.source), run=config.run)


def toml_text(table: Mapping[str, Any]) -> str:
    """A table of a campaign file (texts, numbers, truth values, lists, sections) as TOML.

    >>> print(toml_text({"name": "a", "assembly": {"N": 400, "packings": [1, 2]}}))
    name = "a"
    <BLANKLINE>
    [assembly]
    N = 400
    packings = [1, 2]
    <BLANKLINE>
    """
    return "\n".join(_section(table, ()))


def _section(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    lines = [f"{_key(k)} = {_toml(v)}" for k, v in table.items() if not isinstance(v, Mapping)]
    if path and (lines or not table):
        lines.insert(0, f"[{'.'.join(map(_key, path))}]")
    if lines:
        lines.append("")
    for k, v in table.items():
        if isinstance(v, Mapping):
            lines += _section(v, (*path, k))
    return lines


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _quoted(name)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(k)} = {_toml(v)}" for k, v in value.items()) + "}"
    return _quoted(value) if isinstance(value, str) else str(value)
