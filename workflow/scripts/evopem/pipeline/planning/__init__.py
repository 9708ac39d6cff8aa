"""What the rules of a workflow ask of a configuration: stages with files, arguments, resources."""
