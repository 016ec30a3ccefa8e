"""A bag of ROS 2 as its recorder leaves it: a folder with metadata.yaml and the files that it names.

Source: ROS 2, rosbag2, docs/design and rosbag2_storage/src/rosbag2_storage/metadata_io.cpp.
"""

from __future__ import annotations

import re
from pathlib import Path

from servobench.core.errors import FormatError

METADATA = "metadata.yaml"
_MARK = "rosbag2_bagfile_information"
_LARGEST = 10_000_000  # bytes
_ITEM = re.compile(r"\s*-\s+(?P<name>.+?)\s*")


def is_metadata(path: Path, head: bytes) -> bool:
    """Return whether a file with these first bytes is the metadata of a bag."""
    return path.name == METADATA and _MARK.encode() in head


def metadata_in(folder: Path) -> Path | None:
    """Return the metadata of the bag that a folder is, None where it is none."""
    file = folder / METADATA
    if not file.is_file():
        return None
    with file.open("rb") as stream:
        return file if is_metadata(file, stream.read(4096)) else None


def size_of(file: Path) -> int:
    """Return the size of a file [bytes], of a bag's metadata with that of the bag's files."""
    parts = bag_files(file) if file.name == METADATA else ()
    return sum(each.stat().st_size for each in (file, *parts))


def bag_files(metadata: Path) -> tuple[Path, ...]:
    """Return the files of the bag whose metadata these are, in their order.

    Raises `FormatError` where it names none, one that isn't there, or one outside of the folder.
    """
    if metadata.stat().st_size > _LARGEST:
        raise FormatError(f"{metadata} is too large for a bag's metadata")
    names: list[str] = []
    inside = False
    for line in metadata.read_text(encoding="utf-8", errors="replace").splitlines():
        item = _ITEM.fullmatch(line)
        if inside and item is not None:
            names.append(item["name"].strip("'\""))
        elif line.strip():
            inside = line.strip() == "relative_file_paths:"
    files = tuple(metadata.parent / Path(name).name for name in names if Path(name).name)
    if not files:
        raise FormatError(f"{metadata} lists no file of the bag; give its .mcap or .db3 file instead")
    for file in files:
        if not file.is_file():
            raise FormatError(
                f"the bag {metadata.parent} lacks its file {file.name}; give the others one by one"
            )
    return files
