"""The subcommands of ``coopmm`` that tune: tune, compare, falsify."""
