"""What was found or measured, in plain words."""

from blurmatte.explain.explain import explain as explain
from blurmatte.explain.grade import alternatives_in_words as alternatives_in_words
from blurmatte.explain.grade import alternatives_of as alternatives_of
from blurmatte.explain.grade import doubts as doubts
from blurmatte.explain.grade import grade_in_words as grade_in_words
from blurmatte.explain.grade import likeliest_shape as likeliest_shape
