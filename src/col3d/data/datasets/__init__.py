"""The data sets, one a file, and the code that finds the files of a video and reads them as frames.

Decoding a single file is in `data.files`, frames prepared at one size in `data.cache`.
"""
