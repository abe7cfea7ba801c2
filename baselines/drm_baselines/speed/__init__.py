"""The benchmark behind ``drm bench``: ratios measured in one run, never remembered figures.

Each section measures the engine and what it is compared with in turn (A B A B ...), so that what
else the machine does hits both, and quotes the median ratio of the pairs with its spread. A
section is a module with a function ``run(bench)`` that returns a
:class:`drm_baselines.speed.results.Section`; :mod:`drm_baselines.speed.sections` lists them.
"""
