"""Bodies beside dense computations: their scores, and free forms from true contacts."""
