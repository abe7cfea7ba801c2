"""Reports as one HTML file: what they are made of, and the one maker of them.

A page is a :class:`~drm_baselines.pages.blocks.Page` of sections of blocks (texts, tables,
pictures, flights, episodes, settings); :func:`~drm_baselines.pages.writer.page_text` makes the
file. It holds everything, asks no network, and forbids the browser to ask any. This room knows
neither policies nor flights' origin: colours and labels are given.
"""
