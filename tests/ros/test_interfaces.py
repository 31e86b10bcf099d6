import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests.ros.interfaces import VARIANTS, definitions, environment, why_not

EXCHANGE = Path(__file__).with_name("exchange.py")


@pytest.mark.parametrize("variant", VARIANTS)
def test_each_distribution_has_the_same_interfaces(variant: str) -> None:
    assert definitions(variant).keys() == definitions("kilted").keys()


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["jazzy", "kilted"])
def test_two_processes_exchange_every_interface(variant: str, tmp_path: Path) -> None:
    if reason := why_not():
        pytest.skip(reason)
    variables = os.environ | environment(variant) | {"ROS_LOG_DIR": str(tmp_path)}
    with subprocess.Popen([sys.executable, EXCHANGE, "server"], env=variables) as server:
        try:
            subprocess.run([sys.executable, EXCHANGE, "client"], env=variables, timeout=60, check=True)
        finally:
            server.terminate()
    assert server.returncode == 0
