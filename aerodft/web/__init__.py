"""The page in a browser, to look, click and measure: it shows what ``aerodft.app`` gives and computes nothing."""

from aerodft.web.access import Access
from aerodft.web.server import page_beside, serve_view
