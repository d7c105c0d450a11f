"""Items by key, and a few of many items.

Users: `cli/`, `cosim/`, `drivers/`, `record/`, `report/`, `scenario/`, `scoring/`, `settings/`,
`whatif/`, `extras/`.
"""

from collections.abc import Hashable, Iterable, Sequence
from typing import TypeVar

Key = TypeVar("Key", bound=Hashable)
Item = TypeVar("Item")


def grouped(pairs: Iterable[tuple[Key, Item]]) -> dict[Key, list[Item]]:
    """The items of each key, keys and items in the order of the pairs."""
    groups: dict[Key, list[Item]] = {}
    for key, item in pairs:
        groups.setdefault(key, []).append(item)
    return groups


def evenly_spread(items: Sequence[Item], most: int) -> list[Item]:
    """At most `most` of the items, evenly spread over their list, the first and the last among
    them.
    """
    count = min(most, len(items))
    apart = (len(items) - 1) / max(count - 1, 1)  # indices from one to the next
    return [items[round(number * apart)] for number in range(count)]
