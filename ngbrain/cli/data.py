"""The verb `data`: sample data by name."""

from __future__ import annotations

import argparse

from ngbrain import datasets
from ngbrain.datasets import DATASETS, Dataset
from ngbrain.errors import InputError


def run(arguments: argparse.Namespace) -> None:
    """List the data, or write files and print their paths."""
    if arguments.output.exists() and not arguments.output.is_dir():
        raise InputError("-o", str(arguments.output), "a folder, or a name that is free")
    if not arguments.names:
        print("\n".join(["name          size      what", *(_line(*each) for each in DATASETS.items())]))
    for name in arguments.names:
        for path in datasets.write(name, arguments.output, arguments.overwrite):
            if not arguments.quiet:
                print(f"{path}  {_size(path.stat().st_size)}")


def _line(name: str, dataset: Dataset) -> str:
    return f"{name:<14}{_size(dataset.size):<10}{dataset.summary}"


def _size(count: int) -> str:
    """A number of bytes in words.

    Examples
    --------
    >>> _size(14741), _size(3510351)
    ('15 kB', '3.5 MB')
    """
    return f"{count / 1e3:.0f} kB" if count < 1e6 else f"{count / 1e6:.1f} MB"
