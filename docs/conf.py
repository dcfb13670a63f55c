"""The site: `make docs`."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))
# A part of one's own is defined in a page's cell; what pages import is the checkout.
sys.path.insert(0, str(HERE.parent))

import inventories  # noqa: E402
import torch  # noqa: E402

torch.set_num_threads(1)  # examples and pages are built side by side

os.environ.pop("MPLBACKEND", None)  # cells show their figures by the notebook's own

project = "mann_torch"
author = "the authors of mann_torch"
html_title = "mann_torch"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.intersphinx",
    "sphinx_gallery.gen_gallery",
    "api",
    "mathml",
    "names",
    "outside",
    "titles",
]
exclude_patterns = ["_build", "_ext", "gallery", "**/README.md", "auto_gallery/*.ipynb"]

# Nothing is fetched: the lists are in docs/inventories.
_lists = sorted((HERE / "inventories").glob("*.txt"))
intersphinx_mapping = {
    path.stem: inventories.written(path, HERE / "_build" / "inventories") for path in _lists
}
foreign_names = [name for path in _lists for name, _, _ in inventories.read(path)[1]]

nitpicky = True
smartquotes = False  # W' is a transpose, ... are batch dimensions

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 70
python_use_unqualified_type_names = True
add_module_names = False
toc_object_entries_show_parents = "hide"

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "attrs_inline", "attrs_block"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

nb_execution_mode = "cache"
nb_execution_timeout = 120
nb_execution_raise_on_error = True
nb_execution_cache_path = str(HERE / "_build" / "cells")
nb_merge_streams = True

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "auto_gallery",
    "within_subsection_order": "FileNameSortKey",
    "filename_pattern": r"/plot_",
    "capture_repr": (),
    "thumbnail_size": (640, 400),
    "notebook_extensions": set(),
    "download_all_examples": False,
    "show_signature": False,
    "abort_on_example_error": True,
    "write_computation_times": False,
    "reference_url": {"mann_torch": None},
}

html_math_renderer = "mathml"
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_theme_options = {"top_of_page_buttons": []}
