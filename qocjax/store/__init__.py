"""Results on disk."""

from qocjax.store.files import write_config, write_json, write_table, write_text, written
from qocjax.store.provenance import provenance

__all__ = ["provenance", "write_config", "write_json", "write_table", "write_text", "written"]
