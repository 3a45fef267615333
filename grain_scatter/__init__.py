"""The installed package: the names and modules of `analysis` under the name `grain_scatter`, and the command line.

    from grain_scatter import read_results          # in the repository also: from analysis import read_results
    from grain_scatter.pdem import state_pdf

An installed package holds the folders analysis, campaign, yade_scripts and data of the repository as they are, inside
its own folder, so that it takes no other name in site-packages. In the repository they lie beside this folder.
"""

import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path

_HERE = Path(__file__).resolve().parent
#: The folder with analysis/, campaign/, yade_scripts/ and data/.
HOME = _HERE if (_HERE / "analysis").is_dir() else _HERE.parent
_TEXT = __doc__

__path__ = [str(_HERE), str(HOME / "analysis")]
SourceFileLoader(__name__, str(HOME / "analysis" / "__init__.py")).exec_module(sys.modules[__name__])
__doc__ = f"{_TEXT}\n{__doc__}"
