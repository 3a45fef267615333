#!/bin/sh
# A real SLURM of one node on this machine, from Debian's packages, for the length of one command:
#   sh tests/slurm_node.sh COMMAND...
# Needs root.  Everything listens on loopback and lives in a temporary folder; nothing outlives the command.  Where
# SLURM cannot be had, the command runs without it and finds the reason in NO_SLURM.
set -e
without() {
  reason=$1
  shift
  echo "slurm_node.sh: $reason"
  NO_SLURM="$reason" "$@"
  exit
}
[ "$(id -u)" = 0 ] || without "setting up SLURM needs root" "$@"
if ! command -v slurmctld >/dev/null || ! command -v munged >/dev/null; then
  echo "installing: slurm-wlm munge"
  { apt-get -qq update && DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends \
    slurm-wlm munge </dev/null; } || without "slurm-wlm and munge cannot be installed" "$@"
fi

place=$(mktemp -d /tmp/slurm-node.XXXXXX)
name=$(hostname -s)
port=${SLURM_NODE_PORT:-16817}
SLURM_CONF=
stop() {
  [ -z "$SLURM_CONF" ] || scancel --me 2>/dev/null || true
  for pid in "$place"/slurmd.pid "$place"/slurmctld.pid "$place"/munged.pid; do
    [ -s "$pid" ] && kill "$(cat "$pid")" 2>/dev/null || true
  done
  sleep 1
  rm -rf "$place"
}
trap stop EXIT
trap 'exit 130' INT TERM

chmod 755 "$place"
mkdir -p "$place/munge" "$place/spool" "$place/state"
chmod 711 "$place/munge"
chown munge "$place/munge"
dd if=/dev/urandom of="$place/munge/key" bs=1024 count=1 2>/dev/null
chmod 400 "$place/munge/key"
chown munge "$place/munge/key"
runuser -u munge -- munged --key-file="$place/munge/key" --socket="$place/munge/socket" --force \
  --pid-file="$place/munge/pid" --log-file="$place/munge/log" --seed-file="$place/munge/seed"
cp "$place/munge/pid" "$place/munged.pid"

cat >"$place/slurm.conf" <<EOF
ClusterName=one
SlurmctldHost=$name(127.0.0.1)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$place/munge/socket
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
StateSaveLocation=$place/state
SlurmdSpoolDir=$place/spool
SlurmctldPidFile=$place/slurmctld.pid
SlurmdPidFile=$place/slurmd.pid
SlurmctldLogFile=$place/slurmctld.log
SlurmdLogFile=$place/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
ReturnToService=2
SchedulerParameters=sched_interval=2,bf_interval=5
MinJobAge=600
NodeName=$name NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=$(($(sed -n "s/MemTotal: *\([0-9]*\).*/\1/p" /proc/meminfo) * 9 / 10240)) State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
EOF
export SLURM_CONF="$place/slurm.conf"
slurmctld
slurmd
for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15; do
  [ "$(sinfo -h -o %t 2>/dev/null)" = idle ] && break
  sleep 1
done
if [ "$(sinfo -h -o %t)" != idle ]; then
  tail -5 "$place"/slurmctld.log "$place"/slurmd.log
  without "the SLURM node does not come up" "$@"
fi
"$@"
