"""Filters over scalar components, for small models and very many samples; only `jgait.filtering.filter` needs them."""
