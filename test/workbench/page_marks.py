"""How tests find things on the page."""


def marked(name: str) -> str:
    """Selector of what the page marks with a name for tests."""
    return f"[data-testid={name}]"
