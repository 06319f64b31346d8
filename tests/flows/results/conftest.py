"""Rows with pictures on disk, as the tests of reports make them."""

from tests.reports.conftest import pictured

__all__ = ["pictured"]
