#include "experiments/bridge/serve.h"

#include <fmt/format.h>

#include <atomic>
#include <cerrno>
#include <cmath>
#include <ctime>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include <palpate/device/scheduling.h>
#include <palpate/device/servo_loop.h>
#include <palpate/device/watchdog.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include "device/bridge/bridge_server.h"
#include "device/links/udp_link.h"
#include "experiments/live/session_device.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

constexpr const char* kBridgeSchema = "palpate-bridge/1";
constexpr double kFarSPerMs = 1e-3, kFarNsPerS = 1e9;
constexpr std::int64_t kNsInS = 1'000'000'000;
// Fifty periods of the slowest loop, after which a hanging loop's force is cut.
constexpr std::int64_t kStopPatienceNs = 100'000'000, kStopStepNs = 1'000'000;

void far_sleep_to(std::int64_t monotonic) noexcept {
  const timespec until{static_cast<std::time_t>(monotonic / kNsInS), static_cast<long>(monotonic % kNsInS)};
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

/// Signals between the ticking thread and the one that ends the program.
struct Ending {
  std::atomic<bool> wanted{false}, done{false};
};

/// Ticks at a fixed rate in a thread of its own, with the priority granted. Closes at its end, so no force
/// follows the last zero.
void tick_until(device::BridgeServer& far, const MonotonicClock& clock, const BridgeArguments& arguments,
                device::SchedulingMode& mode, Ending& ending) {
  device::enter_real_time({}, mode);
  device::DueTimes due(std::llround(arguments.rate_hz));
  due.begin(clock.now_ns());
  const auto begun_ns = static_cast<double>(clock.now_ns());
  const double end_ns = arguments.seconds > 0.0 ? begun_ns + kFarNsPerS * arguments.seconds : 1e300;
  while (static_cast<double>(clock.now_ns()) < end_ns && !ending.wanted.load()) {
    far_sleep_to(clock.start_ns() + due.due_ns());
    static_cast<void>(due.take(clock.now_ns()));
    far.tick();
  }
  far.close();
  ending.done.store(true);
}

void print_served(const BridgeArguments& arguments, const device::BridgeServerCounters& counts,
                  const std::string& scheduling) {
  if (arguments.json) {
    const nlohmann::ordered_json document = {
        {"schema", kBridgeSchema},       {"device", arguments.device.device},
        {"scheduling", scheduling},      {"ticks", counts.ticks},
        {"sessions", counts.sessions},   {"accepted", counts.accepted},
        {"malformed", counts.malformed}, {"strange", counts.strange},
        {"overtaken", counts.overtaken}, {"old", counts.old},
        {"trips", counts.trips},         {"releases", counts.releases}};
    fmt::print("{}\n", document.dump(2));
    return;
  }
  fmt::print(
      "{} ticks, {} sessions, {} commands accepted; refused: {} malformed, {} of others, {} overtaken, "
      "{} old; watchdog {} times\n",
      counts.ticks, counts.sessions, counts.accepted, counts.malformed, counts.strange, counts.overtaken,
      counts.old, counts.trips);
}

device::BridgeServerOptions far_options(const BridgeArguments& arguments) {
  device::BridgeServerOptions options;
  options.rate_hz = arguments.rate_hz;
  options.watchdog_s = kFarSPerMs * arguments.watchdog_ms;
  options.max_age_s = kFarSPerMs * arguments.most_age_ms;
  options.user_limit_n = arguments.force_limit_n;
  return options;
}

/// Ticks in a thread of its own and tells the person at this device how to home it.
void serve_and_tell(device::BridgeServer& far, const SessionDevice& session, const MonotonicClock& clock,
                    const BridgeArguments& arguments, device::SchedulingMode& mode, Ending& ending) {
  constexpr std::int64_t kTellEveryNs = 20'000'000;  // below what a person notices
  HomingTeller teller(session, "");
  std::thread loop([&] { tick_until(far, clock, arguments, mode, ending); });
  while (!ending.done.load()) {
    if (const std::optional<std::string> news = teller.news()) tell("palpate: {}\n", *news);
    far_sleep_to(monotonic_ns() + kTellEveryNs);
  }
  loop.join();
}

/// Starts guard, device, watchdog and loop in their required order.
Status serve_device(const BridgeArguments& arguments) {
  const MonotonicClock clock;
  PALPATE_ASSIGN(const DeviceChoice choice, choose_device(arguments.device, session_drivers()));
  PALPATE_ASSIGN(const device::UdpAddress listen, device::UdpAddress::of(arguments.listen));
  PALPATE_ASSIGN(SessionDevice session, SessionDevice::make(choice, clock, 1.0 / arguments.rate_hz));
  session.roam();
  device::ReconnectingDevice& device = session.device();
  device::Heartbeat& heart = session.heart();
  device::UdpPort port(listen);
  PALPATE_TRY(port.open());
  device::BridgeServer far(device, port, clock, far_options(arguments));
  far.watched_by(&heart);
  PALPATE_TRY(far.open());
  device::SchedulingMode mode;
  device::SchedulingOptions scheduling;
  const device::ProcessRealTime process(scheduling, mode);
  Ending ending;
  const StopCallback stop_callback([&device, &ending]() -> std::string {
    ending.wanted.store(true);
    const std::int64_t until = monotonic_ns() + kStopPatienceNs;
    while (!ending.done.load() && monotonic_ns() < until) far_sleep_to(monotonic_ns() + kStopStepNs);
    static_cast<void>(device.cut_force());
    return {};
  });
  device::Watchdog watchdog(device, heart);
  PALPATE_TRY(watchdog.start());
  session.report_unproven();
  if (!arguments.json) {
    fmt::print("{} at {}: forces up to {:.2f} N, zero after {:.0f} ms without a command\n", device.name(),
               port.address().text(), far.governor()->limit_n(), arguments.watchdog_ms);
    std::fflush(stdout);
  }
  serve_and_tell(far, session, clock, arguments, mode, ending);
  heart.rest();
  watchdog.stop();
  print_served(arguments, far.counters(), mode.text());
  return Done{};
}

}  // namespace

Result<int> run_bridge(const BridgeArguments& arguments, Context& /*context*/) {
  PALPATE_TRY(serve_device(arguments));
  return kExitOk;
}

}  // namespace palpate::experiments
