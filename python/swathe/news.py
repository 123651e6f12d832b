"""News of the soil on a drive: from its scenario, from a file that grows, or from the log of the same drive."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Protocol

from swathe.belief import ClassReading, PenetrometerReading
from swathe.episode import Event
from swathe.errors import UnreadableFileError, UsageError
from swathe.soil import SoilClass
from swathe.soil_feed import SoilUpdate, parse_update
from swathe.staging import WORD_RADIUS_M
from swathe.truth import place_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from swathe.drive import Navigator
    from swathe.soil_feed import SoilFeed
    from swathe.staging import Stage

#: What is due: updates and readings of others, and what is to be told of those that cannot be used.
Telling = tuple[list[SoilUpdate | PenetrometerReading | ClassReading], list[dict[str, Any]]]

#: Kinds of the events that tell of news, and of news that could not be used.
NEWS, HEARD, REFUSED = "soil_news", "reading_heard", "soil_news_refused"


class NewsSource(Protocol):
    """Where news comes from besides the scenario."""

    def due(self, time_s: float) -> Telling:
        """Return what is due, and what is to be told of what could not be used."""
        ...

    def finish(self) -> list[dict[str, Any]]:
        """Return what is still to be told of what could not be used, now that the drive is over."""
        ...


class FedNews:
    """News from a file of JSON lines that may grow while the drive goes on."""

    def __init__(self, feed: SoilFeed) -> None:
        self._feed = feed
        self._told = 0

    def due(self, time_s: float) -> Telling:
        """Return what came since the last time."""
        updates: list[SoilUpdate | PenetrometerReading | ClassReading] = list(self._feed.due(time_s))
        return updates, self._refused()

    def finish(self) -> list[dict[str, Any]]:
        """Return what the last line was refused for, where it never became whole."""
        try:
            self._feed.finish()
        except UnreadableFileError as error:
            # The drive is over and needs the file no more.
            return [{"reason": error.message}]
        return self._refused()

    def _refused(self) -> list[dict[str, Any]]:
        """Return what was refused since the last time."""
        new = self._feed.refused[self._told :]
        self._told = len(self._feed.refused)
        return [{"line": line, "reason": reason} for line, reason in new]


class LoggedNews:
    """News as a log tells that it came, for the same drive again."""

    def __init__(self, events: Sequence[Event]) -> None:
        kinds = {NEWS, HEARD, REFUSED}
        self._waiting = [event for event in events if event.kind in kinds and "scenario" not in event.fields]

    def due(self, time_s: float) -> Telling:
        """Return what came at that time."""
        due = [event for event in self._waiting if event.time_s <= time_s]
        self._waiting = self._waiting[len(due) :]
        # What the navigator refused has the fields of news, and is refused again.
        told = [dict(event.fields) for event in due if not _NEWS_FIELDS & event.fields.keys()]
        found = [_from_record(event.fields) for event in due if _NEWS_FIELDS & event.fields.keys()]
        return found, told

    def finish(self) -> list[dict[str, Any]]:
        """Return what was told when the drive was over."""
        left, self._waiting = self._waiting, []
        return [dict(event.fields) for event in left if event.kind == REFUSED]


_NEWS_FIELDS = {"class", "probabilities", "depths_m", "soil_class"}


def _from_record(fields: Mapping[str, Any]) -> SoilUpdate | PenetrometerReading | ClassReading:
    if "depths_m" in fields:
        depths_m, indices_kpa = tuple(fields["depths_m"]), tuple(fields["cone_indices_kpa"])
        sleeve = fields.get("sleeve_frictions_kpa")
        return PenetrometerReading(
            fields["x_m"],
            fields["y_m"],
            depths_m,
            indices_kpa,
            fields.get("refusal_depth_m"),
            None if sleeve is None else tuple(sleeve),
        )
    if "soil_class" in fields:
        return ClassReading(fields["x_m"], fields["y_m"], SoilClass[fields["soil_class"].upper()])
    return parse_update(json.dumps({name: value for name, value in fields.items() if name != "reason"}))


class NewsDesk:
    """Hands news on to the navigator when it is due."""

    def __init__(self, made: Stage, navigator: Navigator, source: NewsSource | None) -> None:
        """Take the scenario's news, and those of a source."""
        self._navigator = navigator
        self._source = source
        self._waiting: list[SoilUpdate] = []
        for told in sorted(made.scenario.soil_news, key=lambda news: news.time_s):
            x_m, y_m, _ = place_of(told, made.route)
            disc = (x_m, y_m, told.radius_m)
            soil = SoilClass[told.soil.upper()]
            self._waiting.append(SoilUpdate(told.time_s, disc=disc, soil_class=soil, source=told.source))

    def tell(self, time_s: float) -> list[Event]:
        """Teach the navigator what is due, and return the events that tell it."""
        due = [update for update in self._waiting if update.time_s <= time_s]
        self._waiting = self._waiting[len(due) :]
        events = [self._teach(update, time_s, {"scenario": True}) for update in due]
        if self._source is not None:
            updates, refused = self._source.due(time_s)
            events += [Event(time_s, REFUSED, told) for told in refused]
            events += [self._teach(update, time_s, {}) for update in updates]
        return events

    def finish(self, time_s: float) -> list[Event]:
        """Return the events that tell what could not be used until the drive was over."""
        return [] if self._source is None else [Event(time_s, REFUSED, told) for told in self._source.finish()]

    def _teach(
        self, news: SoilUpdate | PenetrometerReading | ClassReading, time_s: float, more: dict[str, Any]
    ) -> Event:
        told = {**record_of(news), **more}
        try:
            if isinstance(news, PenetrometerReading):
                self._navigator.learn_reading(news)
                return Event(time_s, HEARD, told)
            if isinstance(news, ClassReading):
                disc = (news.x_m, news.y_m, WORD_RADIUS_M)
                self._navigator.learn_soil(SoilUpdate(time_s, disc=disc, soil_class=news.soil_class))
                return Event(time_s, HEARD, told)
            self._navigator.learn_soil(news)
        except UsageError as error:
            return Event(time_s, REFUSED, {**told, "reason": error.message})
        return Event(time_s, NEWS, told)


def record_of(update: SoilUpdate | PenetrometerReading | ClassReading) -> dict[str, Any]:
    """Return an update as the record of a soil feed, a reading by its own fields."""
    if isinstance(update, PenetrometerReading):
        return {name: value for name, value in asdict(update).items() if value is not None}
    if isinstance(update, ClassReading):
        return {"x_m": update.x_m, "y_m": update.y_m, "soil_class": update.soil_class.name.lower()}
    record: dict[str, Any] = {"time_s": update.time_s}
    if update.polygon is not None:
        record["polygon"] = update.polygon
    if update.disc is not None:
        record |= dict(zip(("x_m", "y_m", "radius_m"), update.disc, strict=True))
    if update.cells is not None:
        record["cells"] = [list(cell) for cell in update.cells]
    if update.soil_class is not None:
        record["class"] = update.soil_class.name.lower()
    if update.probabilities is not None:
        record["probabilities"] = {soil.name.lower(): share for soil, share in update.probabilities.items()}
    if update.source:
        record["source"] = update.source
    if update.cone_index_kpa is not None:
        record["cone_index_kpa"] = update.cone_index_kpa
    return record
