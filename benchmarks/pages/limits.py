"""What falls short, gathered from every page."""

import importlib

from _pages import PAGES, by_hand, listed

ORDER = (
    "meshes", "heads", "retraction", "protocols", "griffiths", "elastography", "elastography_in_space", "measured_waves",
    "harmonic_waves", "derivatives", "inverse_problems", "surrogate", "ladder", "materials", "statics", "viscoelastic_blocks",
    "gpu",
)  # fmt: skip


def every() -> str:
    """Each page's title and what is behind in it, computed first."""
    parts = []
    for topic in ORDER:
        title = (PAGES / f"{topic}.md").read_text().splitlines()[0].removeprefix("# ")
        functions = importlib.import_module(f"pages.{topic}") if (PAGES / f"{topic}.py").exists() else None
        computed = functions.behind() if hasattr(functions, "behind") else ""
        short = "\n".join(filter(None, (computed, listed(by_hand(topic).get("Behind", ())))))
        parts.append(f"## [{title}]({topic}.md)\n\n{short}")
    return "\n\n".join(parts)
