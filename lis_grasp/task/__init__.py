"""The task, split as the world is: configuration, conditions, and what files record of both."""
