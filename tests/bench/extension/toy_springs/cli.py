"""A command."""

from __future__ import annotations

import typer

from shellbench.bench.catalogue.catalog import named_case


def pull(case: str, times: float = 1.0) -> None:
    """Print how far a spring goes."""
    data = named_case(case).data()
    typer.echo(f"{times * data['force'] / data['stiffness']:g} m")
