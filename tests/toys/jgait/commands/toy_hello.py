"""`jgait toy-hello`: a toy."""

from typing import Annotated

import typer


def toy_hello(name: Annotated[str, typer.Option(help="Who is greeted.")] = "nobody") -> None:
    """Greet somebody."""
    print(f"hello {name}")
