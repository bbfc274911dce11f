"""The systems of the documents, one folder each. None of them imports another."""
