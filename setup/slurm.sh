#!/bin/sh
# Start a SLURM of one node on this machine, to try sweeps and to run their tests: munged, slurmctld and slurmd.
# Usage: setup/slurm.sh [stop]. Needs root and Debian's packages slurm-wlm and munge, which it installs.
set -eu
HOME_OF_SLURM=${SLURM_HOME:-/var/tmp/aerial-il-slurm}   # state and logs; removed by "stop"
CONF=/etc/slurm/slurm.conf
MARK="# written by aerial_il's setup/slurm.sh"

say() { echo "slurm: $*" >&2; }

if [ "$(id -u)" != 0 ]; then
  say "must be started by root, once: sudo setup/slurm.sh  (it installs slurm-wlm and munge and starts them)"
  exit 2
fi
if [ -e "$CONF" ] && ! grep -q "$MARK" "$CONF"; then
  say "$CONF is somebody else's: this machine belongs to a cluster already, and nothing was changed."
  exit 2
fi

stop() {
  for name in slurmd slurmctld munged; do
    [ ! -e "$HOME_OF_SLURM/$name.pid" ] || kill "$(cat "$HOME_OF_SLURM/$name.pid")" 2>/dev/null || true
  done
  sleep 1
  rm -rf "$HOME_OF_SLURM" "$CONF"
}

if [ "${1:-}" = stop ]; then
  stop
  say "stopped."
  exit 0
fi

if ! command -v slurmctld >/dev/null || ! command -v munged >/dev/null; then
  command -v apt-get >/dev/null || { say "install SLURM and munge by this system's own means first."; exit 2; }
  say "installing slurm-wlm and munge"
  DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends slurm-wlm munge >/dev/null
fi
if sinfo -h >/dev/null 2>&1; then
  say "is running already: $(sinfo -h -o '%P %T %c cores')"
  exit 0
fi

[ ! -e "$CONF" ] || stop
mkdir -p "$HOME_OF_SLURM/state" "$HOME_OF_SLURM/spool" /etc/munge /run/munge "$(dirname "$CONF")"
if [ ! -e /etc/munge/munge.key ]; then
  (umask 077; head -c 1024 /dev/urandom > /etc/munge/munge.key)
fi
chown -R munge:munge /etc/munge /run/munge
chmod 700 /etc/munge && chmod 400 /etc/munge/munge.key && chmod 755 /run/munge

cat > "$CONF" <<CONF_END
$MARK
ClusterName=aerial
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
StateSaveLocation=$HOME_OF_SLURM/state
SlurmdSpoolDir=$HOME_OF_SLURM/spool
SlurmctldPidFile=$HOME_OF_SLURM/slurmctld.pid
SlurmdPidFile=$HOME_OF_SLURM/slurmd.pid
SlurmctldLogFile=$HOME_OF_SLURM/slurmctld.log
SlurmdLogFile=$HOME_OF_SLURM/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
ReturnToService=2
KillWait=10
OverTimeLimit=0
SchedulerParameters=sched_interval=5,sched_min_interval=100000,batch_sched_delay=0
NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=local Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF_END

if ! munge -n </dev/null >/dev/null 2>&1; then
  setpriv --reuid munge --regid munge --init-groups munged --force
  cp /run/munge/munged.pid "$HOME_OF_SLURM/munged.pid"
fi
slurmctld
slurmd
for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
  if [ "$(sinfo -h -o %T 2>/dev/null)" = idle ]; then
    say "is running: $(sinfo -h -o '%P %c cores'). Stop it: setup/slurm.sh stop"
    exit 0
  fi
  sleep 1
done
say "did not come up; see $HOME_OF_SLURM/slurmctld.log and slurmd.log"
exit 1
