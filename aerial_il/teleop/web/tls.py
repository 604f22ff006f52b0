"""Certificates for a page over https: one's own, or one made on the spot, whose fingerprint is shown.

Browsers hand out a phone's sensors and poses to secure pages only, and a token must not cross a network in the clear.
"""

import hashlib
import shutil
import ssl
import subprocess
from collections.abc import Iterable
from ipaddress import ip_address
from pathlib import Path
from tempfile import TemporaryDirectory

from aerial_il.core.errors import InvalidValueError

DAYS = 30


def own_certificate(certificate: str, key: str) -> tuple[ssl.SSLContext, str]:
    """Return a context of a certificate and its key (PEM files), and the fingerprint.

    Raises:
        InvalidValueError: they cannot be read, or do not belong together.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(certificate, key)
        return context, fingerprint(Path(certificate).read_text(encoding="ascii"))
    except (OSError, ValueError) as error:
        raise InvalidValueError(f"certificate={certificate} key={key}: {error}.") from error


def fresh_certificate(names: Iterable[str]) -> tuple[ssl.SSLContext, str]:
    """Return a context of a certificate made now for ``names`` (names and addresses), and its fingerprint.

    No browser knows it: the fingerprint is what there is to compare. The key never outlives the session.

    Raises:
        InvalidValueError: there is no openssl that makes one.
    """
    openssl = shutil.which("openssl")
    if openssl is None:
        raise InvalidValueError("A page over https needs openssl to make a certificate, or certificate=FILE key=FILE.")
    with TemporaryDirectory(prefix="aerial_il-") as folder:  # readable for its owner alone
        certificate, key = (str(Path(folder) / name) for name in ("certificate.pem", "key.pem"))
        made = subprocess.run(
            [
                *(openssl, "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"),
                *("-keyout", key, "-out", certificate, "-days", str(DAYS), "-subj", "/CN=aerial-il"),
                *("-addext", f"subjectAltName={','.join(map(_alternative, dict.fromkeys(names)))}"),
            ],
            capture_output=True,
            text=True,
            check=False,
        )
        if made.returncode:
            raise InvalidValueError(f"openssl made no certificate: {made.stderr.strip()[-200:]}")
        return own_certificate(certificate, key)


def fingerprint(pem: str) -> str:
    """Return the SHA-256 fingerprint of a certificate, as browsers show it."""
    digest = hashlib.sha256(ssl.PEM_cert_to_DER_cert(pem[pem.index("-----BEGIN CERTIFICATE") :])).hexdigest().upper()
    return ":".join(digest[i : i + 2] for i in range(0, len(digest), 2))


def _alternative(name: str) -> str:
    try:
        return f"IP:{ip_address(name)}"
    except ValueError:
        return f"DNS:{name}"
