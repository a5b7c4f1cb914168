"""``--topic``: which topic of another tool's recording is what."""

from dataclasses import replace
from typing import Annotated

import typer

from aerodft.adapters.config.inputs import Topics
from aerodft.errors import UsageError

TopicOption = Annotated[
    list[str] | None,
    typer.Option("--topic", help="Of another tool's recording: mavlink=/TOPIC, images=/TOPIC, camera=/TOPIC."),
]
_ROLES = ("mavlink", "images", "camera")
_SINGLE = ("images", "camera")


def parse_topics(given: list[str] | None, configured: Topics | None = None) -> Topics:
    """What the options say, else what the configuration says.

    Raises:
        UsageError: An option makes no sense.
    """
    topics, stated = configured or Topics(), dict[str, tuple[str, ...]]()
    for text in given or ():
        role, _, topic = text.partition("=")
        if role not in _ROLES or not topic:
            expected = f"ROLE=TOPIC with one of {', '.join(_ROLES)}"
            raise UsageError("--topic", got=repr(text), expected=expected)
        if role in _SINGLE and role in stated:
            raise UsageError(f"--topic {role} twice", got=topic, expected=f"one topic of {role}")
        stated[role] = (*stated.get(role, ()), topic)
    return replace(topics, **stated)
