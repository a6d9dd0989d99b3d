"""Results on disk."""

from qocjax.store.files import write_config, write_json, write_table, write_text, written

__all__ = ["write_config", "write_json", "write_table", "write_text", "written"]
