"""A narrow link: a proxy that lets so many bytes a second through, late."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

PIECE = 1024


@asynccontextmanager
async def narrowed(port: int, *, bytes_per_s: float, delay_s: float) -> AsyncIterator[int]:
    """Yield a port that leads to ``port`` over a narrow link."""

    async def pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, rate: float) -> None:
        clock = asyncio.get_running_loop().time
        waiting: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(maxsize=16)

        async def arrive() -> None:
            while True:
                due, piece = await waiting.get()
                await asyncio.sleep(max(0.0, due - clock()))
                writer.write(piece)
                await writer.drain()

        arriving, free = asyncio.create_task(arrive()), clock()
        try:
            while piece := await reader.read(PIECE):
                if writer.get_extra_info("peername")[1] == port:  # as a tunnel that keeps the page's own address
                    piece = piece.replace(f"127.0.0.1:{near()}".encode(), f"127.0.0.1:{port}".encode())
                free = max(free, clock()) + len(piece) / rate
                await asyncio.sleep(max(0.0, free - clock()))
                await waiting.put((free + delay_s, piece))
        finally:
            arriving.cancel()
            writer.close()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", port)
        with suppress(ConnectionError):
            await asyncio.gather(pump(reader, far_writer, 1e9), pump(far_reader, writer, bytes_per_s))

    def near() -> int:
        return server.sockets[0].getsockname()[1]

    server = await asyncio.start_server(accept, "127.0.0.1", 0, limit=2 * PIECE)
    try:
        yield near()
    finally:
        server.close()
