"""What a page asks over its WebSocket, checked and answered."""

from functools import partial
from typing import Any, Final, TypeAlias

import orjson

from aerodft.adapters.wire.payload import as_json
from aerodft.app.viewing import View, evidence_of, landmarks_in, probe_of
from aerodft.errors import UsageError

_MOST_PROBES: Final = 64

Document: TypeAlias = dict[str, Any]


class Answers:
    """Answers the questions of a page.

    A question has ``image``, the number of one, and what is wanted of it: ``probes`` to measure, the ``overlay``,
    ``river`` with strokes, ``evidence`` to calibrate with, landmarks to ``import``, or a probe to ``save``.

    Args:
        view: What the page shows.
        is_read_only: Whether nothing may be changed.
    """

    def __init__(self, view: View, *, is_read_only: bool) -> None:
        self._view = view
        self._std_px = 1.0 if view.std_px is None else view.std_px
        self._is_read_only = is_read_only
        self._works = {
            "river": self._river,
            "evidence": self._calibrated,
            "import": self._imported,
            "save": self._saved,
            "overlay": self._overlay,
            "probes": self._measured,
        }

    def question(self, request: bytes) -> Document:
        """The question of a message.

        Raises:
            AerodftError: It is none.
        """
        try:
            asked = orjson.loads(request)
        except orjson.JSONDecodeError as error:
            raise UsageError("the request is no JSON", got=error) from None
        if not isinstance(asked, dict) or type(asked.get("image")) is not int or not self._works.keys() & asked.keys():
            raise UsageError("the request", got=as_json(asked), expected='such as {"image": 0, "probes": [...]}')
        return asked

    def is_quick(self, asked: Document) -> bool:
        """Whether it always takes milliseconds: neither a look at an image's pixels nor a search for a pose."""
        return not {"river", "evidence"} & asked.keys()

    def answer(self, asked: Document) -> Document:
        """The answer to a question.

        Raises:
            AerodftError: It makes no sense, or there is no answer.
        """
        return next(work for key, work in self._works.items() if key in asked)(asked)

    def _measured(self, asked: Document) -> Document:
        probes = asked["probes"]
        if not isinstance(probes, list) or len(probes) > _MOST_PROBES:
            raise UsageError("the request's probes", expected=f"a list of at most {_MOST_PROBES}")
        image = asked["image"]
        found = [probe_of(each, self._std_px, partial(self._view.points, image)) for each in probes]
        answer: Document = {"measurements": self._view.measure(image, found, with_budget=bool(asked.get("budget")))}
        if asked.get("vertical") and found:
            answer["vertical"] = self._view.vertical_px(image, found[0])
        if asked.get("sampling") and found:
            answer["sampling_m"] = self._view.sampling_m(image, found[-1])
        return answer

    def _overlay(self, asked: Document) -> Document:
        return {"overlay": self._view.overlay(asked["image"])}

    def _saved(self, asked: Document) -> Document:
        self._refuse_read_only("to save a probe")
        points, is_tracked = partial(self._view.points, asked["image"]), bool(asked.get("tracked"))
        probe = probe_of(asked["save"], self._std_px, points)
        return {"file": str(self._view.save_probe(asked["image"], probe, is_tracked=is_tracked))}

    def _calibrated(self, asked: Document) -> Document:
        """The camera's pose from what is known of the view; from now on measured with, where that is asked for."""
        use, unknowns = bool(asked.get("use")), asked.get("unknowns")
        if use:
            self._refuse_read_only("to use a calibration")
        if not isinstance(unknowns, list) or not all(isinstance(each, str) for each in unknowns):
            raise UsageError("the unknowns", got=as_json(unknowns), expected="a list of their names")
        evidence, accept = evidence_of(asked["evidence"]), bool(asked.get("accept"))
        return {"calibration": self._view.calibrate(evidence, unknowns, accept=accept, use=use)}

    def _imported(self, asked: Document) -> Document:
        return landmarks_in(asked["import"])

    def _river(self, asked: Document) -> Document:
        """The river in an image, with the strokes of that or another image as hints."""
        told = asked["river"] if isinstance(asked["river"], dict) else {}
        hinted = told.get("image", asked["image"])
        if type(hinted) is not int:
            raise UsageError("the image of the strokes", got=as_json(hinted), expected="its number")
        return {"river": self._view.river(asked["image"], told, hinted)}

    def _refuse_read_only(self, what_for: str) -> None:
        if self._is_read_only:
            raise UsageError("this page only shows", expected=f"one that was not opened read-only, {what_for}")
