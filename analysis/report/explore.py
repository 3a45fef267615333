"""explore.html: one self-contained page on which a person explores the results in a browser, without any network."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from string import Template

from ..errors_and_files import atomic_write
from ..results.reader import Results
from ..tables.explore import explore_data

PAGE = "explore.html"
HERE = Path(__file__).parent


def write_explore(results: Results, folder: str | Path) -> Path:
    """Write explore.html with its data and the library plotly.js; returns its path.

    Raises ModuleNotFoundError if plotly is not installed.
    """
    from plotly.offline import get_plotlyjs

    data = explore_data(results)
    template = Template((HERE / "explore_template.html").read_text(encoding="utf-8"))
    text = template.substitute(
        title=escape(f"{data['campaign']}: explore the results"),
        axial=data["axial"],
        plotly=get_plotlyjs().replace("</script", "<\\/script"),  # would end the element that holds it
        data=json.dumps(data, allow_nan=False).replace("<", "\\u003c"),
        script=(HERE / "explore.js").read_text(encoding="utf-8"),
    )
    path = Path(folder) / PAGE
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")
    return path
