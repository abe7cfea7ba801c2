"""A Ray cluster of several nodes on this machine; tests are skipped where there is no Ray."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from typing import Any

import pytest


def _ports(count: int) -> list[int]:
    with contextlib.ExitStack() as opened:
        sockets = [opened.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("", 0))
        return [each.getsockname()[1] for each in sockets]


def node_arguments() -> dict[str, Any]:
    """Return the arguments of a small node: one core, a small store, ports of its own."""
    names = (
        "metrics_agent_port", "runtime_env_agent_port", "dashboard_agent_listen_port",
        "metrics_export_port",
    )  # fmt: skip
    return {
        **dict(zip(names, _ports(len(names)), strict=True)),
        "num_cpus": 1,
        "object_store_memory": 80 << 20,
        "include_log_monitor": False,
    }


@contextlib.contextmanager
def small_cluster(nodes: int) -> Iterator[Any]:
    """Yield a cluster of so many nodes with a core each; skip where there is none.

    On a machine with much else to do, Ray gives a node up before its helpers have started.
    """
    pytest.importorskip("ray", reason="Ray is not installed")
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    from ray import _raylet
    from ray._private import services
    from ray.cluster_utils import Cluster

    plain = services.start_raylet

    def start_raylet(*arguments: Any, **options: Any) -> Any:
        # the node waits some seconds for its helpers to say their ports, which are known
        with contextlib.suppress(AttributeError, IndexError, TypeError):
            for name in node_arguments():
                if name.endswith("_port") and options.get(name):
                    _raylet.persist_port(arguments[11], arguments[2], name, options[name])
        return plain(*arguments, **options)

    services.start_raylet = start_raylet
    try:
        try:
            cluster = Cluster(
                initialize_head=True,
                head_node_args={**node_arguments(), "include_dashboard": False},
            )
            for _ in range(nodes - 1):
                cluster.add_node(**node_arguments())
        except Exception as error:
            pytest.skip(f"Ray does not start on this machine: {error}")
        try:
            yield cluster
        finally:
            import ray

            ray.shutdown()
            cluster.shutdown()
    finally:
        services.start_raylet = plain
