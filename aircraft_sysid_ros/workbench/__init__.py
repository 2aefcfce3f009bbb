"""The page on which a model is seen to fail, and corrected: views of a run, a server for them, and a file of them."""
