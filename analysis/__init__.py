"""Input statistics, micromechanics, probability density evolution, tables and figures: no YADE needed."""
