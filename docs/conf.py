# The site's settings. docs/build copies the pages and runs Sphinx on the copy.
project = "Palpate"
author = "the Palpate authors"
copyright = "the Palpate authors, GPL-3.0-or-later"
extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
root_doc = "index"
exclude_patterns = ["schemas", "figures", "static"]
html_theme = "furo"
html_title = "Palpate"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
highlight_language = "none"
myst_enable_extensions = ["dollarmath"]
# A link may name any heading down to the fourth level, as on the pages read in a checkout.
myst_heading_anchors = 4
