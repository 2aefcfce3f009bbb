"""The page on which a model is seen to fail, and mended: views of a run, a server for them, and a file of them."""
