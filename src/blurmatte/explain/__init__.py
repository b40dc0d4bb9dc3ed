"""What was found or measured, in plain words."""

from blurmatte.explain.explain import explain as explain
