"""The subcommands of ``robotpack``, one module each; imported only when they are run."""
