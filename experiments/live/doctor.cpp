#include "experiments/live/doctor.h"

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <ctime>
#include <filesystem>
#include <span>
#include <system_error>
#include <thread>
#include <utility>

#include <palpate/clock.h>
#include <palpate/options.h>
#include "device/drivers/all_drivers.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"
#include "toolkit/spline_sdf/paged_surface.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;

// Median lateness of sleeps that prevents a servo: half the fastest servo's period.
constexpr std::int64_t kLateMedianNs = 60'000;
// Sleeps without high-resolution timers end with the kernel's tick, 1 ms or longer: no 1 kHz servo.
constexpr std::int64_t kCoarseClockNs = 1'000'000;
// At 1 % stolen time a servo misses ticks every second.
constexpr double kStealPercent = 1.0;
// The kernel's default, which leaves a twentieth for other threads.
constexpr std::int64_t kUsualShareUs = 950'000;
constexpr std::int64_t kTriedForNs = 100'000'000, kTriedPeriodNs = 1'000'000;

/// First line of a system file; empty if missing.
std::string line_of(const std::string& path) {
  Result<InputFile> file = InputFile::open(path);
  if (!file) return {};
  std::array<char, 256> text{};
  const Result<std::size_t> read = file->read(std::as_writable_bytes(std::span(text)));
  if (!read) return {};
  const std::string_view all(text.data(), *read);
  return std::string(all.substr(0, all.find('\n')));
}

/// Entries of a system folder, sorted.
std::vector<fs::path> entries_of(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code none;
  for (fs::directory_iterator it(folder, none), end; !none && it != end; it.increment(none))
    found.push_back(it->path());
  std::sort(found.begin(), found.end());
  return found;
}

std::vector<std::string> governors() {
  std::vector<std::string> found;
  for (const fs::path& cpu : entries_of("/sys/devices/system/cpu/cpufreq"))
    if (std::string name = line_of((cpu / "scaling_governor").string()); !name.empty())
      if (std::find(found.begin(), found.end(), name) == found.end()) found.push_back(std::move(name));
  return found;
}

/// Name of the device's node of this kind below its sysfs folder: "hidraw3", "ttyACM0". Empty if there is
/// none.
std::string node_below(const fs::path& at, const std::string& kind) {
  std::error_code none;
  for (fs::recursive_directory_iterator it(at, none), end; !none && it != end; it.increment(none)) {
    const std::string name = it->path().filename().string();
    if (name.starts_with(kind) && name.size() > kind.size()) return "/dev/" + name;
  }
  return {};
}

std::string node_of(const fs::path& at, device::UsbNode kind) {
  if (kind == device::UsbNode::kHidraw) return node_below(at, "hidraw");
  if (kind == device::UsbNode::kTty) return node_below(at, "ttyACM");
  const Result<long long> bus = read_integer(line_of((at / "busnum").string()), {0, 999});
  const Result<long long> number = read_integer(line_of((at / "devnum").string()), {0, 999});
  return bus && number ? fmt::format("/dev/bus/usb/{:03}/{:03}", *bus, *number) : std::string();
}

bool in_a_virtual_machine() {
  std::error_code none;
  if (fs::exists("/sys/hypervisor/type", none)) return true;
  Result<InputFile> file = InputFile::open("/proc/cpuinfo");
  if (!file) return false;
  // The first processor's flags are in the first 8 KB.
  std::array<char, 8192> text{};
  const Result<std::size_t> read = file->read(std::as_writable_bytes(std::span(text)));
  return read && std::string_view(text.data(), *read).find(" hypervisor") != std::string_view::npos;
}

/// Requests the watchdog's scheduling and measures periodic sleeps with what was granted.
void try_it(SystemFacts& facts) {
  device::DurationHistogram lateness;
  device::SchedulingOptions options;
  options.priority = device::kWatchdogPriority;
  const device::ProcessRealTime process(options, facts.tried);
  std::thread thread([&] {
    device::enter_real_time(options, facts.tried);
    const std::int64_t begun = monotonic_ns();
    for (std::int64_t due = begun + kTriedPeriodNs; due < begun + kTriedForNs; due += kTriedPeriodNs) {
      constexpr std::int64_t kNsPerS = 1'000'000'000;
      const timespec until{static_cast<std::time_t>(due / kNsPerS), static_cast<long>(due % kNsPerS)};
      ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
      lateness.count(monotonic_ns() - due);
    }
  });
  thread.join();
  facts.lateness = lateness.statistics();
}

/// `resource` has a type private to the C library.
template <class Resource>
std::uint64_t limit_of(Resource resource) {
  rlimit limit{};
  if (::getrlimit(resource, &limit) != 0) return 0;
  return limit.rlim_cur == RLIM_INFINITY ? SystemFacts::kUnlimited : limit.rlim_cur;
}

std::vector<std::string> limits_remedy() {
  return {"write these lines to /etc/security/limits.d/90-palpate.conf, as root:",
          fmt::format("    @realtime - rtprio {}", device::kWatchdogPriority),
          "    @realtime - memlock unlimited",
          "and then: sudo groupadd --force realtime && sudo usermod --append --groups realtime $USER",
          "log out and in again"};
}

std::vector<std::string> udev_remedy(const std::string& rule) {
  return {"write this line to /etc/udev/rules.d/70-palpate.rules, as root:", "    " + rule,
          "and then: sudo udevadm control --reload && sudo udevadm trigger"};
}

Check fine(std::string name, std::string found) {
  return {std::move(name), CheckVerdict::kFine, std::move(found), {}};
}

Check priority(const SystemFacts& facts) {
  if (facts.tried.fifo)
    return fine("real-time priority", fmt::format("SCHED_FIFO {} is granted", facts.tried.priority));
  return {"real-time priority", CheckVerdict::kWarning,
          fmt::format(
              "SCHED_FIFO {} is refused (the limit rtprio is {}): whatever else runs makes the servo late",
              device::kWatchdogPriority, facts.rtprio_limit),
          limits_remedy()};
}

Check memory(const SystemFacts& facts) {
  const std::string limit = facts.memlock_limit_bytes == SystemFacts::kUnlimited
                                ? "unlimited"
                                : format_bytes(static_cast<double>(facts.memlock_limit_bytes));
  const std::string wanted = fmt::format("a prepared surface wants {} more than the program (resident_mb={})",
                                         format_bytes(static_cast<double>(spline_sdf::kResidentBytes)),
                                         spline_sdf::kResidentBytes >> 20);
  if (facts.tried.memory_locked && facts.memlock_limit_bytes > spline_sdf::kResidentBytes)
    return fine("locked memory", "memory can be locked");
  return {"locked memory", CheckVerdict::kWarning,
          fmt::format("{} (the limit memlock is {}, and {}): a page that was swapped out stops a frame",
                      facts.tried.memory_locked ? "not all memory can be locked" : "memory cannot be locked",
                      limit, wanted),
          limits_remedy()};
}

Check kernel(const SystemFacts& facts) {
  const std::string found =
      fmt::format("{} ({})", facts.tried.kernel_release, device::kernel_kind_name(facts.tried.kernel));
  if (facts.tried.kernel == device::KernelKind::kRealTime) return fine("kernel", found);
  return {"kernel",
          CheckVerdict::kWarning,
          found + ": now and then it makes a tick late by a millisecond and more",
          {"with a device, run a kernel with PREEMPT_RT; on Debian: sudo apt install linux-image-rt-amd64"}};
}

Check cpus(const SystemFacts& facts) {
  const std::string found = fmt::format("{} may be used", facts.tried.cpus);
  if (facts.tried.cpus > 1) return fine("CPUs", found);
  return {"CPUs",
          CheckVerdict::kWarning,
          found + ": the servo shares it with everything else",
          {"use a machine with two CPUs or more, or allow this process more (taskset, cpuset)"}};
}

Check governor(const SystemFacts& facts) {
  if (facts.cpu_governors.empty())
    return fine("CPU governor", "the machine does not tell of one: its clock is not scaled here");
  const std::string found = joined(facts.cpu_governors);
  if (facts.cpu_governors == std::vector<std::string>{"performance"}) return fine("CPU governor", found);
  return {"CPU governor",
          CheckVerdict::kWarning,
          found + ": a CPU that sleeps between ticks is slow in each",
          {"sudo cpupower frequency-set --governor performance"}};
}

Check sleep_states(const SystemFacts& facts) {
  if (!facts.has_latency_file)
    return fine("CPU sleep states", "/dev/cpu_dma_latency is not there: nothing to hold awake");
  if (facts.tried.latency_held) return fine("CPU sleep states", "/dev/cpu_dma_latency can be held at 0");
  return {"CPU sleep states", CheckVerdict::kWarning,
          "/dev/cpu_dma_latency may not be written: CPUs that sleep deeply wake up late",
          udev_remedy("KERNEL==\"cpu_dma_latency\", GROUP=\"realtime\", MODE=\"0660\"")};
}

Check timer(const SystemFacts& facts) {
  const std::string source = facts.clock_source.empty() ? "clock source not told" : facts.clock_source;
  const std::string found = fmt::format(
      "{}, steps of {} ns; sleeps of 1 ms end late by {} at the median, {} at 99 %", source,
      facts.clock_resolution_ns, format_duration(1e-6 * static_cast<double>(facts.lateness.p50_ns)),
      format_duration(1e-6 * static_cast<double>(facts.lateness.p99_ns)));
  if (facts.clock_resolution_ns >= kCoarseClockNs)
    return {"timer",
            CheckVerdict::kProblem,
            found,
            {"boot a kernel with CONFIG_HIGH_RES_TIMERS, without highres=off"}};
  if (facts.clock_source == "hpet" || facts.clock_source == "acpi_pm" || facts.clock_source == "jiffies")
    return {"timer",
            CheckVerdict::kWarning,
            found + ": every reading of this clock takes a microsecond or more",
            {"boot with tsc=reliable where the processor's counter is (see dmesg | grep -i tsc)"}};
  if (facts.lateness.p50_ns > kLateMedianNs)
    return {
        "timer", CheckVerdict::kWarning, found, {"stop what else runs, or get real-time priority (above)"}};
  return fine("timer", found);
}

Check real_time_share(const SystemFacts& facts) {
  if (!facts.real_time_share_us)
    return fine("real-time share", "the kernel does not limit it by a file of its own");
  const std::int64_t share = *facts.real_time_share_us;
  const std::string found = share < 0 ? std::string("not limited") : fmt::format("{} of 1,000,000 us", share);
  if (share == kUsualShareUs) return fine("real-time share", found);
  return {"real-time share",
          CheckVerdict::kWarning,
          found + (share < 0 ? ": a renderer that hangs would take a CPU for ever"
                             : ": the kernel stops real-time threads that take more"),
          {fmt::format("sudo sysctl kernel.sched_rt_runtime_us={}", kUsualShareUs)}};
}

Check host(const SystemFacts& facts) {
  const std::string found =
      fmt::format("{}; {:.2f} % of the CPUs' time was stolen since it started",
                  facts.virtual_machine ? "a virtual machine" : "no virtual machine", facts.steal_percent);
  if (!facts.virtual_machine && facts.steal_percent < kStealPercent) return fine("host and steal", found);
  return {"host and steal",
          CheckVerdict::kWarning,
          found + ": its host may stop it at any time, and nothing is claimed beyond the 99.9th percentile",
          {"with a device, use a machine of its own"}};
}

Check usb(const SystemFacts& facts) {
  if (!facts.has_usb)
    return {
        "USB permission", CheckVerdict::kFine, "this machine has no USB; simulated devices need none", {}};
  if (facts.usb.empty())
    return fine("USB permission", "no haptic device that is known by its ids is connected");
  std::vector<std::string> names, remedy, rules;
  bool refused = false;
  for (const UsbDevice& device : facts.usb) {
    names.push_back(fmt::format("{} ({}:{}): {}", device.name, device.vendor, device.product,
                                device.may_open ? "may be opened" : "may not be opened by this user"));
    if (device.may_open) continue;
    refused = true;
    rules.push_back("    " + device.rule);
  }
  if (refused) {
    std::sort(rules.begin(), rules.end());
    rules.erase(std::unique(rules.begin(), rules.end()), rules.end());
    remedy = {
        "write to /etc/udev/rules.d/70-palpate.rules, as root (or install Palpate: it brings that file):"};
    remedy.insert(remedy.end(), rules.begin(), rules.end());
    remedy.emplace_back("and then: sudo udevadm control --reload && sudo udevadm trigger");
    remedy.emplace_back("then unplug the device and plug it in again");
  }
  return {"USB permission", refused ? CheckVerdict::kWarning : CheckVerdict::kFine, joined(names, "; "),
          remedy};
}

}  // namespace

std::vector<UsbDevice> connected_usb_devices() {
  std::vector<UsbDevice> found;
  for (const fs::path& at : entries_of("/sys/bus/usb/devices")) {
    const std::string vendor = line_of((at / "idVendor").string()),
                      product = line_of((at / "idProduct").string());
    for (const device::UsbId& known : device::known_usb_ids()) {
      if (vendor != known.vendor || (known.product[0] != '\0' && product != known.product)) continue;
      UsbDevice device{known.name, vendor, product, node_of(at, known.node), false, {}};
      device.may_open = ::access(device.node.c_str(), R_OK | W_OK) == 0;
      device.rule = device::udev_rule(known);
      found.push_back(std::move(device));
    }
  }
  return found;
}

SystemFacts read_system_facts() {
  SystemFacts facts;
  facts.rtprio_limit = limit_of(RLIMIT_RTPRIO);
  facts.memlock_limit_bytes =
      device::has_capability(device::kCapIpcLock) ? SystemFacts::kUnlimited : limit_of(RLIMIT_MEMLOCK);
  facts.cpu_governors = governors();
  facts.has_latency_file = ::access("/dev/cpu_dma_latency", F_OK) == 0;
  timespec step{};
  if (::clock_getres(CLOCK_MONOTONIC, &step) == 0) facts.clock_resolution_ns = step.tv_nsec;
  facts.clock_source = line_of("/sys/devices/system/clocksource/clocksource0/current_clocksource");
  const Result<long long> share =
      read_integer(line_of("/proc/sys/kernel/sched_rt_runtime_us"), {-1, 1'000'000'000});
  if (share) facts.real_time_share_us = *share;
  facts.steal_percent = device::steal_percent({0, 0}, device::steal_times());
  facts.virtual_machine = in_a_virtual_machine();
  facts.has_usb = ::access("/dev/bus/usb", F_OK) == 0;
  facts.usb = connected_usb_devices();
  try_it(facts);
  return facts;
}

const char* verdict_name(CheckVerdict verdict) noexcept {
  switch (verdict) {
    case CheckVerdict::kFine:
      return "fine";
    case CheckVerdict::kWarning:
      return "warning";
    case CheckVerdict::kProblem:
      return "problem";
  }
  return "problem";
}

std::vector<Check> examine(const SystemFacts& facts) {
  return {priority(facts),     memory(facts), kernel(facts),          cpus(facts), governor(facts),
          sleep_states(facts), timer(facts),  real_time_share(facts), host(facts), usb(facts)};
}

}  // namespace palpate::experiments
