"""The editor of protocols: a form and a text, two views of one document."""
