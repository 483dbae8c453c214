"""Map reset: all landmarks are triangulated anew after some keyframes (F7); off by default.

Nistér, Naroditsky and Bergen (2004) call it a firewall: no error of the structure reaches beyond.
"""

from vo.config import RefinementSettings
from vo.map.local_map import LocalMap, empty_map


def reset_if_due(local_map: LocalMap, settings: RefinementSettings) -> LocalMap:
    """Replace the map by an empty one if it has lasted for `map_reset_keyframes`."""
    limit = settings.map_reset_keyframes
    if not 0 < limit <= local_map.next_serial - local_map.first_serial:
        return local_map
    return empty_map(local_map.next_serial, local_map.next_id, local_map.noise)
