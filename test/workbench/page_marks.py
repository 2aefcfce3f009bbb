"""How tests find things on the page."""

from __future__ import annotations


def marked(name: str) -> str:
    """Selector of what the page marks with a name for tests."""
    return f"[data-testid={name}]"


def wait_for_text(page, name: str, text: str, timeout: float = 300_000) -> None:
    """Wait until what has a name for tests says something."""
    from playwright.sync_api import TimeoutError as PlaywrightTimeout

    try:
        page.wait_for_function(
            "([s, t]) => document.querySelector(s)?.innerText.includes(t)", arg=[marked(name), text], timeout=timeout
        )
    except PlaywrightTimeout:
        raise AssertionError(f"no '{text}' in {name}: {page.inner_text('body')}") from None
