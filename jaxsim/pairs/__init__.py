"""Frames to training pairs: made from a data set's frames once and kept, or written as a set of their own."""
