"""The data sets, one a file, and how the files of a video are found and read as frames.

Decoding a single file is in `data.files`, frames prepared at one size in `data.cache`.
"""
