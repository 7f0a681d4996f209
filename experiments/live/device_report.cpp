#include "experiments/live/doctor.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <ctime>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include <palpate/device/servo_loop.h>
#include <palpate/device/watchdog.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include "experiments/live/session_device.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

using FactsJson = nlohmann::ordered_json;

constexpr double kFactsUsPerNs = 1e-3;

void facts_sleep_to(std::int64_t monotonic) noexcept {
  constexpr std::int64_t kSecondNs = 1'000'000'000;
  const timespec until{static_cast<std::time_t>(monotonic / kSecondNs),
                       static_cast<long>(monotonic % kSecondNs)};
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

FactsJson facts_vector(const Vec3& v) {
  return FactsJson::array({v.x(), v.y(), v.z()});
}

FactsJson facts_durations(const device::DurationHistogram& histogram) {
  const device::DurationStatistics of = histogram.statistics();
  const auto us = [](std::int64_t ns) { return kFactsUsPerNs * static_cast<double>(ns); };
  return {{"count", of.count},
          {"min_us", us(of.min_ns)},
          {"p50_us", us(of.p50_ns)},
          {"p99_us", us(of.p99_ns)},
          {"p999_us", us(of.p999_ns)},
          {"max_us", us(of.max_ns)},
          {"mean_us", kFactsUsPerNs * of.mean_ns}};
}

FactsJson facts_bins(const PowerBins& bins) {
  FactsJson list = FactsJson::array();
  for (std::size_t k = 0; k < PowerBins::kBins; ++k)
    if (bins.counts[k] > 0)
      list.push_back(
          {{"below_us", kFactsUsPerNs * std::ldexp(1.0, static_cast<int>(k))}, {"count", bins.counts[k]}});
  return list;
}

FactsJson facts_packets(const DeviceWatch& watch) {
  FactsJson raw = FactsJson::array();
  for (std::size_t i = 0; i < watch.packets_held; ++i) {
    std::string hex;
    for (std::size_t k = 0; k < watch.packets[i].size; ++k)
      hex += fmt::format("{:02x}", watch.packets[i].bytes[k]);
    raw.push_back(hex);
  }
  return {{"frames", watch.frames},
          {"fresh", watch.fresh},
          {"nothing_new", watch.nothing_new},
          {"garbled", watch.garbled},
          {"lost", watch.lost},
          {"longest_gap_ms", 1e-6 * static_cast<double>(watch.longest_gap_ns)},
          {"interval", facts_durations(watch.interval)},
          {"interval_bins", facts_bins(watch.interval_bins)},
          {"first", std::move(raw)}};
}

FactsJson facts_limits(const device::DeviceLimits& limits) {
  constexpr const char* kShapes[] = {"box", "ellipsoid", "cylinder"};
  return {{"force_max_n", limits.force_max_n},
          {"workspace_low_mm", facts_vector(limits.workspace_mm.low_mm)},
          {"workspace_high_mm", facts_vector(limits.workspace_mm.high_mm)},
          {"workspace_shape", kShapes[static_cast<std::size_t>(limits.workspace_shape)]},
          {"resolution_mm", limits.resolution_mm},
          {"rate_hz", limits.rate_hz},
          {"stiffness_max_n_per_mm", limits.stiffness_max_n_per_mm},
          {"damping_max_n_s_per_mm", limits.damping_max_n_s_per_mm}};
}

void add_watch(FactsJson& document, const DeviceWatch& watch) {
  document["packets"] = facts_packets(watch);
  document["latency"] = {{"exchange", facts_durations(watch.exchange)},
                         {"age", facts_durations(watch.age)},
                         {"age_bins", facts_bins(watch.age_bins)},
                         {"lateness", facts_durations(watch.lateness)}};
  document["homing"] = {{"at_start", watch.homed_at_start},
                        {"after_s", watch.homed_after_s ? FactsJson(*watch.homed_after_s) : FactsJson()},
                        {"at_end", watch.homed_at_end}};
  document["motion"] = {{"low_mm", facts_vector(watch.low_mm)},
                        {"high_mm", facts_vector(watch.high_mm)},
                        {"smallest_step_mm", facts_vector(watch.smallest_step_mm)},
                        {"buttons_seen", watch.buttons_seen}};
}

FactsJson facts_connected() {
  FactsJson seen = FactsJson::array();
  for (const UsbDevice& one : connected_usb_devices())
    seen.push_back({{"name", one.name},
                    {"vendor", one.vendor},
                    {"product", one.product},
                    {"node", one.node},
                    {"may_open", one.may_open}});
  return seen;
}

/// Runs frames at a fixed rate in a thread with the priority that the system grants.
void look_for(DeviceObserver& observer, const MonotonicClock& clock, const ReportOptions& options,
              device::Heartbeat& heart, device::SchedulingMode& mode) {
  device::enter_real_time({}, mode);
  device::DueTimes due(std::llround(options.rate_hz));
  due.begin(clock.now_ns());
  const std::int64_t end_ns = clock.now_ns() + std::llround(1e9 * options.seconds);
  while (clock.now_ns() < end_ns) {
    const std::int64_t due_ns = due.due_ns();
    facts_sleep_to(clock.start_ns() + due_ns);
    static_cast<void>(due.take(clock.now_ns()));
    heart.beat();
    observer.frame(due_ns);
  }
  heart.rest();
}

/// Watches in a thread of its own and tells the person what homing needs. Returns what was told.
std::vector<std::string> observe(DeviceObserver& observer, SessionDevice& device, const MonotonicClock& clock,
                                 const ReportOptions& options, device::SchedulingMode& mode) {
  constexpr std::chrono::milliseconds kTellEvery{20};  // below what a person notices
  std::vector<std::string> told;
  HomingTeller teller(device, "");
  const auto tell = [&] {
    const std::optional<std::string> news = teller.news();
    if (!news) return;
    palpate::tell("palpate: {}\n", *news);
    told.push_back(*news);
  };
  std::atomic<bool> over{false};
  std::thread loop([&] {
    look_for(observer, clock, options, device.heart(), mode);
    over.store(true);
  });
  while (!over.load()) {
    tell();
    std::this_thread::sleep_for(kTellEvery);
  }
  loop.join();
  tell();
  return told;
}

/// Starts device, watchdog and loop in their required order; the guard already runs.
Status look_at(SessionDevice& session, const MonotonicClock& clock, const ReportOptions& options,
               FactsJson& document) {
  device::ReconnectingDevice& device = session.device();
  PALPATE_TRY(device.open());
  device::GovernorOptions governed;
  governed.period_s = 1.0 / options.rate_hz;
  PALPATE_ASSIGN(device::ForceGovernor governor, device::ForceGovernor::create(device.limits(), governed));
  const StopCallback stop_callback([&device]() -> std::string {
    static_cast<void>(device.cut_force());
    return {};
  });
  device::SchedulingMode mode;
  const auto observer = std::make_unique<DeviceObserver>(device, governor, clock);
  std::vector<std::string> told;
  {
    const device::ProcessRealTime process({}, mode);
    device::Watchdog watchdog(device, session.heart());
    PALPATE_TRY(watchdog.start());
    told = observe(*observer, session, clock, options, mode);
    watchdog.stop();
  }
  document["limits"] = facts_limits(device.limits());
  document["scheduling"] = mode.text();
  add_watch(document, observer->watch());
  document["homing"]["told"] = told;
  FactsJson facts = FactsJson::object();
  for (const auto& [key, value] : session.facts()) facts[key] = value;
  document["facts"] = std::move(facts);
  device.close();
  return Done{};
}

}  // namespace

void PowerBins::count(std::int64_t ns) noexcept {
  const auto width =
      static_cast<std::size_t>(std::bit_width(static_cast<std::uint64_t>(std::max<std::int64_t>(ns, 0))));
  ++counts[std::min(width, kBins - 1)];
}

void DeviceObserver::frame(std::int64_t due_ns) noexcept {
  const std::int64_t began_ns = clock_.now_ns();
  const device::DeviceState state = device_.read();
  device_.send(governor_.zero());
  const std::int64_t now_ns = clock_.now_ns();
  watch_.exchange.count(now_ns - began_ns);
  watch_.lateness.count(began_ns - due_ns);
  if (watch_.frames == 0) {
    watch_.homed_at_start = state.homed;
    first_ns_ = fresh_ns_ = began_ns;
  }
  ++watch_.frames;
  watch_.homed_at_end = state.homed;
  if (state.homed && !watch_.homed_at_start && !watch_.homed_after_s)
    watch_.homed_after_s = 1e-9 * static_cast<double>(now_ns - first_ns_);
  took(state, now_ns);
}

void DeviceObserver::took(const device::DeviceState& state, std::int64_t now_ns) noexcept {
  watch_.longest_gap_ns = std::max(watch_.longest_gap_ns, now_ns - fresh_ns_);
  switch (state.status) {
    case device::ReadStatus::kNothingNew:
      ++watch_.nothing_new;
      return;
    case device::ReadStatus::kGarbled:
      ++watch_.garbled;
      return;
    case device::ReadStatus::kLost:
      ++watch_.lost;
      return;
    case device::ReadStatus::kFresh:
      break;
  }
  const bool first = watch_.fresh == 0;
  ++watch_.fresh;
  watch_.buttons_seen |= state.buttons;
  if (!first) {
    watch_.interval.count(now_ns - fresh_ns_);
    watch_.interval_bins.count(now_ns - fresh_ns_);
  }
  fresh_ns_ = now_ns;
  // A device without packet times has no packet age.
  if (state.packet_ns > 0) {
    watch_.age.count(now_ns - state.packet_ns);
    watch_.age_bins.count(now_ns - state.packet_ns);
  }
  if (state.raw.size > 0 && watch_.packets_held < DeviceWatch::kMostPackets)
    watch_.packets[watch_.packets_held++] = state.raw;
  if (!is_finite(state.position_mm)) return;
  watch_.low_mm = first ? state.position_mm : watch_.low_mm.cwiseMin(state.position_mm).eval();
  watch_.high_mm = first ? state.position_mm : watch_.high_mm.cwiseMax(state.position_mm).eval();
  for (int axis = 0; axis < 3 && !first; ++axis) {
    const double step_mm = std::abs(state.position_mm[axis] - before_mm_[axis]);
    double& least_mm = watch_.smallest_step_mm[axis];
    if (step_mm > 0.0 && (least_mm == 0.0 || step_mm < least_mm)) least_mm = step_mm;
  }
  before_mm_ = state.position_mm;
}

Result<ReportedDevice> report_device(const DeviceArguments& arguments, const device::Drivers& drivers,
                                     const ReportOptions& options, const metrics::DocumentHead& head) {
  const MonotonicClock clock;
  PALPATE_ASSIGN(const DeviceChoice choice, choose_device(arguments, drivers));
  PALPATE_ASSIGN(SessionDevice session, SessionDevice::make(choice, clock, 1.0 / options.rate_hz));
  session.roam();
  const device::Driver& driver = *drivers.of(arguments.device);
  FactsJson document = {{"schema", kDeviceReportSchema}};
  document.update(FactsJson::parse(metrics::head_json(head)));
  FactsJson given = FactsJson::object();
  for (const auto& [key, value] : choice.request.options) given[key] = value;
  document["device"] = {{"name", arguments.device},      {"driver", driver.name},
                        {"transport", driver.transport}, {"description", arguments.file},
                        {"options", std::move(given)},   {"unproven", session.unproven()}};
  document["connected"] = facts_connected();
  document["seconds"] = options.seconds;
  document["rate_hz"] = options.rate_hz;
  ReportedDevice reported;
  const Status looked = look_at(session, clock, options, document);
  if (!looked) reported.not_opened = looked.error();
  document["opened"] = looked.ok();
  document["error"] = looked ? "" : looked.error().message();
  reported.json = document.dump(1) + "\n";
  return reported;
}

}  // namespace palpate::experiments
