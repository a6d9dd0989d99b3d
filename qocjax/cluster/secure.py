"""TLS between driver, scheduler and workers: Dask's own, by certificates in files or made for one run."""

from __future__ import annotations

import importlib.util
import os
from dataclasses import dataclass

from distributed.security import Security

from qocjax._reading import check_regular

__all__ = ["Certificates", "security_of"]

_FILES = ("ca", "cert", "key")


@dataclass(frozen=True)
class Certificates:
    """Files in PEM: who may take part shows a certificate that this authority signed, and its private key."""

    ca: str
    cert: str
    key: str

    def security(self) -> Security:
        """Dask's settings, for every role alike.

        Raises:
            ValueError: A file is not there.
        """
        files = {name: os.path.expanduser(getattr(self, name)) for name in _FILES}
        for name, file in files.items():
            try:
                check_regular(file)
            except ValueError as error:
                raise ValueError(f"engine.tls_{name}: {error}") from None
        roles = {f"tls_{role}_{name}": files[name] for role in ("client", "scheduler", "worker")
                 for name in ("cert", "key")}  # fmt: skip
        return Security(require_encryption=True, tls_ca_file=files["ca"], **roles)


def security_of(tls: str | None, ca: str | None, cert: str | None, key: str | None) -> Security | None:
    """What the options of an engine ask; None for messages in the clear.

    Args:
        tls: `temporary` for certificates that are made for this run, and known to it and its workers alone.
        ca: File with the certificate of the authority.
        cert: File with one's own certificate.
        key: File with its private key.

    Raises:
        ValueError: Only some files are given, or files beside `temporary`, or one is missing, or `temporary` without
            the package cryptography.
    """
    given = dict(zip(_FILES, (ca, cert, key), strict=True))
    missing = [name for name, file in given.items() if file is None]
    if missing and len(missing) < len(_FILES):
        raise ValueError(f"engine.tls_{missing[0]}: got null beside other files, expected all three, or none")
    if ca is not None and cert is not None and key is not None:
        if tls is not None:
            raise ValueError(f"engine.tls: got {tls} beside certificates in files, expected one of them")
        return Certificates(ca, cert, key).security()
    if tls is None:
        return None
    if importlib.util.find_spec("cryptography") is None:
        raise ValueError("engine.tls: got temporary without cryptography, expected `pip install cryptography`, or "
                         "certificates in files (engine.tls_ca, tls_cert, tls_key)")  # fmt: skip
    return Security.temporary()
