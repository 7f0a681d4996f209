#include "tests/device/link_faults.h"

#include <fmt/format.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <limits>
#include <map>
#include <thread>

#include <palpate/clock.h>
#include <palpate/device/drivers.h>
#include <palpate/device/guard.h>
#include <palpate/device/scheduling.h>
#include <palpate/device/servo.h>
#include <palpate/device/watchdog.h>
#include "tests/device/rig.h"
#include "toolkit/core/files.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::device {
namespace {

constexpr double kPressN = 1.0, kPressedEnoughN = 0.9;
constexpr double kPressPatience = 30.0;      // s, of a busy machine
constexpr std::int64_t kTickNs = 1'000'000;  // 1 kHz
constexpr double kHeldBackMs = 30.0;         // of late packets
constexpr double kStuckMs = 60.0, kKillAfterMs = 50.0;
constexpr int kTicksToZero = 2;
constexpr std::uint64_t kOneComesOf = 1000;  // of lost packets
constexpr timespec kLook{0, 200'000}, kOwnTime{1, 0};

/// Pushes towards the middle, or up where the device is there, until it goes wrong: a rest pose may lie at
/// the workspace's edge, where a governor fades what pushes outward.
class PushingRenderer final : public render::SceneFreeRenderer {
 public:
  render::Frame step(const Vec3& hip_mm, double) noexcept override {
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    frame.contact = true;
    constexpr double kAtMiddleMm = 1.0;
    const double away_mm = hip_mm.norm();
    frame.force_n = away_mm > kAtMiddleMm ? Vec3(-kPressN / away_mm * hip_mm) : Vec3(0.0, 0.0, kPressN);
    if (nan) frame.force_n.setConstant(std::numeric_limits<double>::quiet_NaN());
    const double stuck = std::exchange(stuck_ms, 0.0);
    if (stuck > 0.0) std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(stuck));
    return frame;
  }
  render::Description describe() const override { return {"push", "", "", "constant", {}}; }
  bool nan = false;
  double stuck_ms = 0.0;
};

struct Limits {
  GovernorOptions governor;
  WatchdogOptions watchdog;
  double held_back_ms = kHeldBackMs, stuck_ms = kStuckMs, felt_through_ms = 150.0;
  bool late_until_seen = false;  ///< a busy machine may not look once between the limit and their coming
};

Limits limits_of(const LinkFaultOptions& options) {
  Limits limits;
  limits.governor.soft_start_s = 0.02;
  if (options.as_in_a_session) return limits;
  constexpr double kSilenceS = 1.0, kWatchdogS = 1.0;  // far more than a busy machine takes
  limits.governor.late_zero_s = limits.governor.latch_late_s = kPressPatience;
  limits.governor.silence_s = kSilenceS;
  limits.watchdog = {kWatchdogS, 0.01};
  limits.held_back_ms = 1e3 * kSilenceS + kHeldBackMs;
  limits.late_until_seen = true;
  limits.stuck_ms = 3e3 * kWatchdogS;
  limits.felt_through_ms = 300.0;
  return limits;
}

double ms_since(std::int64_t then_ns, std::int64_t now_ns) {
  return 1e-6 * static_cast<double>(now_ns - then_ns);
}

/// One trial on a device of this process.
class Trial {
 public:
  Trial(LinkBench& bench, LinkWrong wrong, const Limits& limits)
      : bench_(bench),
        wrong_(wrong),
        limits_(limits),
        servo_(renderer_, limits.governor, bench.device(), clock_, {}),
        watchdog_(bench.device(), heart_, limits.watchdog) {}
  ~Trial() {
    servo_.stop();
    watchdog_.stop();
  }

  LinkFaultOutcome run() {
    servo_.watched_by(&heart_);
    if (!servo_.start() || !watchdog_.start() || !press()) return outcome_;
    outcome_.counts = true;
    wrong_ns_ = monotonic_ns();
    spoil();
    const double most_ms = may_be_felt_through() ? limits_.felt_through_ms : 1e3 * kPressPatience;
    while (ms_since(wrong_ns_, monotonic_ns()) < most_ms) {
      if (wrong_ == LinkWrong::kLate && ms_since(wrong_ns_, monotonic_ns()) > limits_.held_back_ms &&
          (!limits_.late_until_seen || outcome_.fault != Fault::kNone))
        bench_.replies.heal();
      take(tick());
      constexpr double kForGoodMs = 60.0;  // no force came back for so long
      const std::int64_t since_ns = std::max(bench_.held.until_ns(), detected_ns_);
      if (outcome_.fault != Fault::kNone && ms_since(since_ns, monotonic_ns()) > kForGoodMs) break;
    }
    outcome_.held_at_end = bench_.held.holds();
    if (outcome_.held_at_end || outcome_.fault == Fault::kNone) return outcome_;
    const std::int64_t until_ns = bench_.held.until_ns();
    outcome_.zero_ms = std::max(0.0, ms_since(wrong_ns_, until_ns));
    outcome_.within_two_ticks = until_ns - detected_ns_ <= kTicksToZero * kTickNs;
    return outcome_;
  }

 private:
  [[nodiscard]] bool may_be_felt_through() const {
    return wrong_ == LinkWrong::kDuplicated && !bench_.counts_packets();
  }
  Tick tick() {
    next_ns_ = std::max(next_ns_ + kTickNs, monotonic_ns());
    const timespec until{next_ns_ / 1'000'000'000, static_cast<long>(next_ns_ % 1'000'000'000)};
    ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
    return servo_.tick();
  }
  bool press() {
    const Stopwatch watch;
    int pressed = 0;
    constexpr int kLongEnough = 30;  // ticks
    while (pressed < kLongEnough) {
      const Tick now = tick();
      if (now.fault != Fault::kNone || watch.ms() > 1e3 * kPressPatience) return false;
      pressed = now.sent_n.norm() > kPressedEnoughN && bench_.held.holds() ? pressed + 1 : 0;
    }
    return true;
  }
  void spoil() {
    if (wrong_ == LinkWrong::kUnplugged)
      bench_.unplug();
    else if (wrong_ == LinkWrong::kNan)
      renderer_.nan = true;
    else if (wrong_ == LinkWrong::kStuck)
      renderer_.stuck_ms = limits_.stuck_ms;
    else
      bench_.replies.set(wrong_);
  }
  void take(const Tick& now) {
    if (now.fault == Fault::kNone) return;
    if (outcome_.fault == Fault::kNone) {
      outcome_.fault = now.fault;
      detected_ns_ = watchdog_.trips() > 0 ? watchdog_.tripped_ns() : monotonic_ns();
      outcome_.detected_ms = ms_since(wrong_ns_, detected_ns_);
    }
    outcome_.commanded_zero = outcome_.commanded_zero && now.sent_n == Vec3::Zero();
  }

  LinkBench& bench_;
  LinkWrong wrong_;
  Limits limits_;
  MonotonicClock clock_;
  PushingRenderer renderer_;
  Heartbeat heart_;
  Servo servo_;
  Watchdog watchdog_;
  LinkFaultOutcome outcome_;
  std::int64_t next_ns_ = 0, wrong_ns_ = 0, detected_ns_ = 0;
};

/// The program that presses, until it dies.
pid_t start_pressing(LinkBench& bench, int signal) {
  std::vector<std::string> arguments = {"/proc/self/exe", kPressArgument,
                                        fmt::format("{}", signal == SIGSTOP ? kKillAfterMs : 0.0)};
  for (const std::string& one : bench.program()) arguments.push_back(one);
  std::vector<char*> argv;
  for (std::string& one : arguments) argv.push_back(one.data());
  argv.push_back(nullptr);
  const pid_t child = ::fork();
  if (child == 0) {
    ::execv(argv[0], argv.data());
    ::_exit(9);
  }
  return child;
}

/// One trial on a process of its own, which dies.
LinkFaultOutcome run_link_death(LinkBench& bench, int signal) {
  LinkFaultOutcome outcome;
  outcome.died = true;
  pid_t child = start_pressing(bench, signal);
  const Stopwatch pressing;
  while (!bench.held.holds() && pressing.ms() < 1e3 * kPressPatience) {
    ::nanosleep(&kLook, nullptr);
    if (::waitpid(child, nullptr, WNOHANG) != child) continue;
    // It was refused: the device may still be another program's, which was killed before.
    constexpr timespec kReleaseContact{0, 200'000'000};
    ::nanosleep(&kReleaseContact, nullptr);
    child = start_pressing(bench, signal);
  }
  outcome.counts = bench.held.holds();
  constexpr timespec kSettled{0, 50'000'000};
  ::nanosleep(&kSettled, nullptr);
  const std::int64_t wrong_ns = monotonic_ns();
  ::kill(child, signal);
  constexpr double kGoneMs = 300.0;
  const Stopwatch waited;
  while (waited.ms() < 1e3 * kPressPatience && ms_since(bench.held.until_ns(), monotonic_ns()) < kGoneMs)
    ::nanosleep(&kLook, nullptr);
  outcome.held_at_end = bench.held.holds();
  if (!outcome.held_at_end) outcome.zero_ms = std::max(0.0, ms_since(wrong_ns, bench.held.until_ns()));
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  return outcome;
}

/// Right: seen and let go; or nobody can see it, and it is felt through.
bool is_right(LinkBench& bench, LinkWrong wrong, const LinkFaultOutcome& outcome) {
  if (outcome.died) return !outcome.held_at_end;
  if (wrong == LinkWrong::kDuplicated && !bench.counts_packets())
    return outcome.fault == Fault::kNone && outcome.held_at_end;
  return outcome.fault != Fault::kNone && !outcome.held_at_end && outcome.commanded_zero;
}

LinkFaultOutcome counted_fault(LinkBench& bench, LinkWrong wrong, const LinkFaultOptions& options) {
  constexpr int kTries = 8;  // of which a machine that stands still may spoil some
  LinkFaultOutcome outcome;
  for (int i = 0; i < kTries && !outcome.counts; ++i) outcome = run_link_fault(bench, wrong, options);
  return outcome;
}

std::string p50_and_most(std::vector<double> values) {
  if (values.empty()) return "- / -";
  std::sort(values.begin(), values.end());
  return fmt::format("{:.1f} / {:.1f}", values[values.size() / 2], values.back());
}

const char* seen_as(const LinkFaultOutcome& one) {
  if (one.died) return "the guard process";
  return one.fault == Fault::kNone ? "felt through" : fault_name(one.fault);
}

struct Row {
  int runs = 0, right = 0, commanded = 0, in_two = 0;
  std::map<std::string, int> seen;
  std::vector<double> detected_ms, zero_ms;
  void add(LinkBench& bench, LinkWrong wrong, const LinkFaultOutcome& one) {
    ++runs;
    ++seen[seen_as(one)];
    right += is_right(bench, wrong, one) ? 1 : 0;
    commanded += one.commanded_zero ? 1 : 0;
    in_two += one.within_two_ticks ? 1 : 0;
    if (one.detected_ms >= 0.0) detected_ms.push_back(one.detected_ms);
    if (one.zero_ms >= 0.0) zero_ms.push_back(one.zero_ms);
  }
  [[nodiscard]] std::string seen_text() const {
    std::string all;
    for (const auto& [name, times] : seen)
      all += (all.empty() ? "" : ", ") + name + (seen.size() > 1 ? fmt::format(" ({})", times) : "");
    return all;
  }
};

}  // namespace

const char* link_wrong_name(LinkWrong wrong) noexcept {
  constexpr std::array<const char*, kLinkWrongs> kNames = {"silent",
                                                           "short packets",
                                                           "garbled packets",
                                                           "late packets, 30 ms",
                                                           "lost packets, 999 of 1000",
                                                           "duplicated packets",
                                                           "unplugged",
                                                           "renderer answers NaN",
                                                           "renderer stuck for 60 ms",
                                                           "kill -9",
                                                           "stopped (SIGSTOP), killed after 50 ms"};
  return kNames[static_cast<std::size_t>(wrong)];
}

void SpoiltReplies::set(LinkWrong wrong) {
  const std::lock_guard lock(mutex_);
  spoilt_ = true;
  wrong_ = wrong;
}

void SpoiltReplies::heal() {
  const std::lock_guard lock(mutex_);
  spoilt_ = false;
}

std::vector<SpoiltReplies::Bytes> SpoiltReplies::instead_of(Bytes reply) {
  const std::lock_guard lock(mutex_);
  if (!spoilt_) {
    std::vector<Bytes> all = std::exchange(held_, {});
    last_ = reply;
    all.push_back(std::move(reply));
    return all;
  }
  switch (wrong_) {
    case LinkWrong::kShort:
      reply.resize(reply.size() / 2 + 1);
      return {reply};
    case LinkWrong::kGarbled:
      // The upper half of a number in the middle: no letter, no digit, no checksum, or a place far away.
      reply[reply.size() / 2 + 1] ^= 0x40U;
      return {reply};
    case LinkWrong::kLate:
      held_.push_back(std::move(reply));
      return {};
    case LinkWrong::kLost:
      return ++count_ % kOneComesOf == 0 ? std::vector<Bytes>{reply} : std::vector<Bytes>{};
    case LinkWrong::kDuplicated:
      return {last_};
    default:
      return {};
  }
}

LinkFaultOutcome run_link_fault(LinkBench& bench, LinkWrong wrong, const LinkFaultOptions& options) {
  if (wrong == LinkWrong::kKilled) return run_link_death(bench, SIGKILL);
  if (wrong == LinkWrong::kStopped) return run_link_death(bench, SIGSTOP);
  const LinkFaultOutcome outcome = Trial(bench, wrong, limits_of(options)).run();
  bench.replies.heal();
  if (wrong == LinkWrong::kUnplugged && outcome.counts)
    bench.plug();  // it was unplugged, and nothing refers to the old device any more
  return outcome;
}

void press_until_killed(const std::vector<std::string>& arguments) {
  const MonotonicClock clock;
  Drivers drivers;
  register_all_drivers(drivers);
  DeviceRequest request;
  request.name = arguments.at(1);
  for (std::size_t i = 2; i < arguments.size(); ++i) {
    const std::size_t equals = arguments[i].find('=');
    request.options.emplace_back(arguments[i].substr(0, equals), arguments[i].substr(equals + 1));
  }
  const Driver* driver = drivers.of(request.name);
  if (driver == nullptr) ::_exit(2);
  Result<MadeDevice> made = driver->make(request, clock);
  if (!made) {
    fmt::print(stderr, "{}\n", made.error().message());
    ::_exit(3);
  }
  Result<Guard> guard = Guard::start(made->zero, {std::strtod(arguments.at(0).c_str(), nullptr) * 1e-3});
  if (!guard) ::_exit(4);
  PushingRenderer renderer;
  Limits limits = limits_of({});
  limits.governor.silence_s = kPressPatience;
  Servo servo(renderer, limits.governor, *made->device, clock, {});
  servo.watched_by(&guard->heartbeat());
  if (const Status started = servo.start(); !started) {
    fmt::print(stderr, "{}\n", started.error().message());
    ::_exit(5);
  }
  constexpr timespec kPeriod{0, kTickNs};
  for (;;) {
    static_cast<void>(servo.tick());
    ::nanosleep(&kPeriod, nullptr);
  }
}

bool measure_link_faults(LinkBench& bench, int runs, std::string& rows_json) {
  bool all_right = true;
  for (int i = 0; i < kLinkWrongs; ++i) {
    const auto wrong = static_cast<LinkWrong>(i);
    Row row;
    int tried = 0;
    for (; row.runs < runs && tried < 5 * runs; ++tried)
      if (const LinkFaultOutcome one = run_link_fault(bench, wrong, {true}); one.counts)
        row.add(bench, wrong, one);
      else
        ::nanosleep(&kOwnTime, nullptr);  // who was there before may still be waited for
    fmt::print("| {} | {} | {} | {} | {} | {} of {} | {} of {} |\n", link_wrong_name(wrong), bench.link(),
               row.seen_text(), p50_and_most(row.detected_ms), p50_and_most(row.zero_ms), row.in_two,
               row.detected_ms.empty() ? 0 : row.runs, row.right, row.runs);
    std::fflush(stdout);
    const auto most = [](const std::vector<double>& of) {
      return of.empty() ? -1.0 : *std::max_element(of.begin(), of.end());
    };
    rows_json += fmt::format(
        R"({}{{"link": "{}", "fault": "{}", "seen_as": "{}", "runs": {}, "void": {}, "right": {}, )"
        R"("commanded_zero": {}, "board_zero_in_two_ticks": {}, "detected_most_ms": {:.3f}, "zero_most_ms": {:.3f}}})",
        rows_json.empty() ? "" : ",\n ", bench.link(), link_wrong_name(wrong), row.seen_text(), row.runs,
        tried - row.runs, row.right, row.commanded, row.in_two, most(row.detected_ms), most(row.zero_ms));
    all_right = all_right && row.right == row.runs && row.runs == runs;
  }
  return all_right;
}

int measured_faults(int argc, char** argv, const std::function<bool(int, std::string&)>& measure) {
  constexpr int kUsage = 2, kLeastWords = 4;
  const int runs = argc >= kLeastWords ? std::atoi(argv[2]) : 0;
  if (runs < 1) {
    fmt::print(stderr, "error: how often, and where to; usage: --faults RUNS FILE.json\n");
    return kUsage;
  }
  SchedulingMode mode;
  enter_real_time({.pin = false}, mode);
  fmt::print(
      "| fault | link | seen as | detected, ms: p50 / max | zero, ms: p50 / max | board within two ticks | "
      "right |\n"
      "| --- | --- | --- | ---: | ---: | ---: | ---: |\n");
  std::string rows;
  const bool right = measure(runs, rows);
  const std::string document =
      fmt::format("{{\"scheduling\": \"{}\", \"faults\": [\n {}\n]}}\n", mode.text(), rows);
  if (const Status written = write_file(argv[3], document); !written) {
    fmt::print(stderr, "error: {}\n", written.error().message());
    return kUsage;
  }
  return right ? 0 : 1;
}

std::string violations_of(LinkBench& bench, LinkWrong wrong) {
  const LinkFaultOutcome one = counted_fault(bench, wrong, {});
  const std::string what = bench.link() + ", " + link_wrong_name(wrong) + ": ";
  if (!one.counts) return what + "it never pressed";
  fmt::print("{}{}\n", what, seen_as(one));
  if (is_right(bench, wrong, one)) return {};
  return what + fmt::format("{}{}{}", fault_name(one.fault), one.held_at_end ? ", a force is left" : "",
                            one.commanded_zero ? "" : ", a force was commanded after the fault");
}

}  // namespace palpate::device
