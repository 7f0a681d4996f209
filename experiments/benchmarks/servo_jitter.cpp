// Lateness of servo ticks compared with cyclictest (rt-tests). Alternating slices of both use the same CPU,
// priority and minute. Cases: a costless renderer and a costly one on a real scene; an idle machine and a
// memory-bound thread on each CPU. Prints a table and JSON.
//
//   servo_jitter [KEY=VALUE ...]     seconds=60 slice=5 rates=1000,4000 loads=idle,loaded points=1002001
//                                    renderers=none,mls-proxy spin=true json=FILE
#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <palpate/baselines.h>
#include <palpate/device/servo_thread.h>
#include <palpate/options.h>
#include <palpate/registry.h>
#include <palpate/result.h>
#include "device/simulated/simulated_device.h"
#include "experiments/benchmarks/generated_scene.h"
#include "toolkit/core/files.h"
#include "toolkit/core/process.h"
#include "toolkit/render/wrapped_renderer.h"

namespace {

using namespace palpate;
using Json = nlohmann::ordered_json;

/// A renderer without force or cost.
class NoRenderer final : public render::SceneFreeRenderer {
 public:
  render::Frame step(const Vec3& hip_mm, double) noexcept override {
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    return frame;
  }
  render::Description describe() const override { return {"none", "", "", "constant", {}}; }
};

/// Loads memory and a CPU: walks 64 MB, beyond every cache, line by line.
class Competitor {
 public:
  explicit Competitor(int cpu) : thread_([this, cpu] { run(cpu); }) {}
  Competitor(const Competitor&) = delete;
  Competitor& operator=(const Competitor&) = delete;
  ~Competitor() {
    stop_.store(true);
    thread_.join();
  }

 private:
  void run(int cpu) {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(static_cast<std::size_t>(cpu), &set);
    ::pthread_setaffinity_np(::pthread_self(), sizeof set, &set);
    constexpr std::size_t kBytes = std::size_t{64} << 20, kLine = 64;
    std::vector<unsigned char> memory(kBytes);
    while (!stop_.load())
      for (std::size_t i = 0; i < kBytes; i += kLine) memory[i] = static_cast<unsigned char>(memory[i] + 1);
  }
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// Records every tick's lateness in preallocated memory; rearms after a fault so the renderer continues.
class Book final : public device::TickObserver {
 public:
  explicit Book(std::size_t room) { lateness_ns.reserve(room); }
  void took(const device::Tick& tick) noexcept override {
    if (lateness_ns.size() < lateness_ns.capacity()) lateness_ns.push_back(tick.t_ns - tick.due_ns);
    missed += tick.missed;
    stepped += tick.step_ns > 0 ? 1 : 0;
    longest_step_ns = tick.restarted ? longest_step_ns : std::max(longest_step_ns, tick.step_ns);
    if (tick.fault == device::Fault::kNone) return;
    ++faults;
    if (thread != nullptr) thread->request_rearm();
  }
  std::vector<std::int64_t> lateness_ns;
  std::uint64_t missed = 0, stepped = 0, faults = 0;
  std::int64_t longest_step_ns = 0;
  device::ServoThread* thread = nullptr;
};

/// Lateness in whole microseconds, as cyclictest counts it.
struct Counts {
  std::map<std::int64_t, std::uint64_t> by_us;
  std::uint64_t total = 0;
  std::int64_t most_us = 0;
  void add(std::int64_t us, std::uint64_t times) {
    by_us[us] += times;
    total += times;
    most_us = std::max(most_us, us);
  }
  /// Nearest rank.
  [[nodiscard]] std::int64_t percentile(double share) const {
    const auto rank = static_cast<std::uint64_t>(std::ceil(share * static_cast<double>(total)));
    std::uint64_t below = 0;
    for (const auto& [us, times] : by_us)
      if ((below += times) >= std::max<std::uint64_t>(rank, 1)) return us;
    return most_us;
  }
};

struct Row {
  std::int64_t rate_hz = 0;
  std::string load, who;
  Counts lateness;
  std::uint64_t missed = 0, overruns = 0, stepped = 0, faults = 0;
  std::int64_t longest_step_ns = 0;
  std::vector<std::int64_t> step_p50_ns, step_p99_ns;  // per slice
  double steal_percent = 0.0;                          // largest of a slice
  std::string mode;
};

struct Arguments {
  double seconds = 60.0, slice = 5.0;
  std::vector<std::int64_t> rates = {1000, 4000};
  std::vector<std::string> loads = {"idle", "loaded"}, renderers = {"none", "mls-proxy"};
  std::string points = "1002001", json;
  bool spin = true;
};

Result<Arguments> read_arguments(int argc, char** argv) {
  Arguments a;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i], key = word.substr(0, word.find('='));
    const std::string value = word.size() > key.size() ? word.substr(key.size() + 1) : "";
    constexpr NumberRange kSeconds{0.1, 86400.0};
    if (key == "seconds" || key == "slice") {
      PALPATE_ASSIGN(const double number, read_number(value, kSeconds));
      (key == "slice" ? a.slice : a.seconds) = number;
    } else if (key == "rates") {
      a.rates.clear();
      for (const std::string& one : split_list(value)) {
        PALPATE_ASSIGN(const long long rate, read_integer(one, {static_cast<double>(device::kMinServoHz),
                                                                static_cast<double>(device::kMaxServoHz)}));
        a.rates.push_back(rate);
      }
    } else if (key == "loads") {
      a.loads = split_list(value);
    } else if (key == "renderers") {
      a.renderers = split_list(value);
    } else if (key == "points") {
      PALPATE_ASSIGN(const long long points, read_integer(value, {100, 20'000'000}));
      a.points = std::to_string(points);
    } else if (key == "spin") {
      a.spin = value == "true";
    } else if (key == "json") {
      a.json = value;
    } else {
      return Error{"unknown key " + key,
                   "give seconds, slice, rates, loads, renderers, points, spin or json"};
    }
  }
  for (const std::string& load : a.loads)
    if (load != "idle" && load != "loaded") return Error{"unknown load " + load, "give idle or loaded"};
  return a;
}

struct Scene {
  experiments::GeneratedScene played;
  std::map<std::string, std::unique_ptr<render::HapticRenderer>> renderers;
};

Result<Scene> make_scene(const Arguments& a) {
  Scene scene;
  PALPATE_ASSIGN(scene.played, experiments::generated_scene("sinusoid:points=" + a.points,
                                                            fmt::format("weave:frames={}:depth_mm=1",
                                                                        std::llround(1000.0 * a.slice))));
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  baselines::register_baseline_renderers(registry);
  for (const std::string& name : a.renderers) {
    if (name == "none") {
      scene.renderers[name] = std::make_unique<NoRenderer>();
      continue;
    }
    PALPATE_ASSIGN(const NamedOptions named, parse_named_options(name));
    PALPATE_ASSIGN(scene.renderers[name], registry.make(named.name, named.options));
    fmt::print(stderr, "preparing {} on {} points\n", name, a.points);
    PALPATE_TRY(scene.renderers[name]->prepare(scene.played.input, {}));
  }
  return scene;
}

Status run_servo(const Arguments& a, Scene& scene, const std::string& name, int cpu, Row& row) {
  const MonotonicClock clock;
  device::DeviceLimits limits;
  limits.force_max_n = 3.3;
  limits.workspace_mm = {Vec3::Constant(-1000.0), Vec3::Constant(1000.0)};
  limits.resolution_mm = 0.055;
  limits.rate_hz = static_cast<double>(row.rate_hz);
  device::SimulatedDevice played(scene.played.path, clock, limits, 0);
  device::GovernorOptions governed;
  governed.period_s = 1.0 / static_cast<double>(row.rate_hz);
  device::Servo servo(*scene.renderers.at(name), governed, played, clock, {});
  Book book(static_cast<std::size_t>(2.0 * a.slice * static_cast<double>(row.rate_hz)));
  device::ServoThreadOptions options;
  options.rate_hz = row.rate_hz;
  options.scheduling.cpu = cpu;
  options.spin = a.spin;
  const std::array<device::TickObserver*, 1> observers = {&book};
  PALPATE_ASSIGN(const auto thread, device::ServoThread::create(servo, clock, options, observers));
  book.thread = thread.get();
  PALPATE_TRY(thread->start());
  std::this_thread::sleep_for(std::chrono::duration<double>(a.slice));
  thread->stop();
  const device::LoopStatistics all = thread->histograms().statistics();
  constexpr std::int64_t kNsPerUs = 1000;
  for (const std::int64_t late : book.lateness_ns) row.lateness.add(late / kNsPerUs, 1);
  row.missed += book.missed;
  row.overruns += all.overruns;
  row.stepped += book.stepped;
  row.faults += book.faults;
  row.longest_step_ns = std::max(row.longest_step_ns, book.longest_step_ns);
  row.step_p50_ns.push_back(all.step.p50_ns);
  row.step_p99_ns.push_back(all.step.p99_ns);
  row.steal_percent = std::max(row.steal_percent, thread->steal_percent());
  row.mode = thread->mode().text();
  return Done{};
}

Status run_cyclictest(const Arguments& a, int cpu, Row& row) {
  constexpr int kMostUs = 20'000;
  constexpr double kUsPerS = 1e6, kGraceS = 10.0;
  const device::StealTimes before = device::steal_times(cpu);
  const std::vector<std::string> words = {
      "cyclictest",
      "-m",
      "-q",
      "-t1",
      "-p" + std::to_string(device::kServoPriority),
      "-a" + std::to_string(cpu),
      "-i" + std::to_string(std::llround(kUsPerS / static_cast<double>(row.rate_hz))),
      "-h" + std::to_string(kMostUs),
      "-l" + std::to_string(std::llround(a.slice * static_cast<double>(row.rate_hz)))};
  PALPATE_ASSIGN(const ProcessOutcome run, run_process(words, {.time_limit_s = 3.0 * a.slice + kGraceS}));
  if (run.exit_code != 0)
    return Error{"cyclictest ended with " + std::to_string(run.exit_code) + ": " + run.err};
  std::istringstream lines(run.out);
  std::uint64_t overflows = 0;
  std::int64_t most_us = 0;
  for (std::string line; std::getline(lines, line);) {
    std::istringstream text(line);
    std::int64_t us = 0;
    std::uint64_t times = 0;
    if (line.starts_with("# Histogram Overflows:"))
      overflows = std::stoull(line.substr(line.find(':') + 1));
    else if (line.starts_with("# Max Latencies:"))
      most_us = std::stoll(line.substr(line.find(':') + 1));
    else if (!line.starts_with("#") && text >> us >> times && times > 0)
      row.lateness.add(us, times);
  }
  if (overflows > 0) row.lateness.add(std::max<std::int64_t>(most_us, kMostUs), overflows);
  row.steal_percent = std::max(row.steal_percent, device::steal_percent(before, device::steal_times(cpu)));
  row.mode = "SCHED_FIFO " + std::to_string(device::kServoPriority);
  return Done{};
}

std::string load_average() {
  std::ifstream file("/proc/loadavg");
  std::string text;
  std::getline(file, text);
  return text;
}

std::int64_t median_of(std::vector<std::int64_t> values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

void print(const std::vector<Row>& rows) {
  fmt::print("{:>5} {:<7} {:<14} {:>8} {:>5} {:>5} {:>6} {:>7} {:>7} {:>8} {:>7} {:>10} {:>10} {:>7}\n", "Hz",
             "load", "who", "ticks", "p50", "p99", "p99.9", "max us", "missed", "overruns", "faults",
             "step50 us", "step99 us", "steal %");
  for (const Row& r : rows)
    fmt::print(
        "{:>5} {:<7} {:<14} {:>8} {:>5} {:>5} {:>6} {:>7} {:>7} {:>8} {:>7} {:>10.2f} {:>10.2f} {:>7.2f}\n",
        r.rate_hz, r.load, r.who, r.lateness.total, r.lateness.percentile(0.5), r.lateness.percentile(0.99),
        r.lateness.percentile(0.999), r.lateness.most_us, r.missed, r.overruns, r.faults,
        1e-3 * static_cast<double>(median_of(r.step_p50_ns)),
        1e-3 * static_cast<double>(median_of(r.step_p99_ns)), r.steal_percent);
}

Json json_of(const Row& r) {
  return {{"label", fmt::format("{}-{}-{}", r.rate_hz, r.load, r.who)},
          {"rate_hz", r.rate_hz},
          {"load", r.load},
          {"who", r.who},
          {"mode", r.mode},
          {"ticks", r.lateness.total},
          {"lateness_us",
           {{"p50", r.lateness.percentile(0.5)},
            {"p99", r.lateness.percentile(0.99)},
            {"p999", r.lateness.percentile(0.999)},
            {"max", r.lateness.most_us}}},
          {"missed", r.missed},
          {"overruns", r.overruns},
          {"stepped", r.stepped},
          {"faults", r.faults},
          {"step_us",
           {{"p50", 1e-3 * static_cast<double>(median_of(r.step_p50_ns))},
            {"p99", 1e-3 * static_cast<double>(median_of(r.step_p99_ns))},
            {"max", 1e-3 * static_cast<double>(r.longest_step_ns)}}},
          {"steal_percent", r.steal_percent}};
}

/// Measures one rate under one load in alternating slices.
Status measure(const Arguments& a, Scene& scene, std::int64_t rate, const std::string& load, bool cyclictest,
               int cpus, std::vector<Row>& rows) {
  std::vector<Row> turn;
  const auto add = [&](const std::string& who) {
    Row& row = turn.emplace_back();
    row.rate_hz = rate;
    row.load = load;
    row.who = who;
  };
  if (cyclictest) add("cyclictest");
  for (const std::string& name : a.renderers) add(name);
  std::vector<std::unique_ptr<Competitor>> competitors;
  if (load == "loaded")
    for (int cpu = 0; cpu < cpus; ++cpu) competitors.push_back(std::make_unique<Competitor>(cpu));
  const auto slices = static_cast<int>(std::max(1.0, std::ceil(a.seconds / a.slice)));
  for (int slice = 0; slice < slices; ++slice)
    for (Row& row : turn) {
      if (row.who == "cyclictest") {
        PALPATE_TRY(run_cyclictest(a, cpus - 1, row));
      } else {
        PALPATE_TRY(run_servo(a, scene, row.who, cpus - 1, row));
      }
    }
  rows.insert(rows.end(), turn.begin(), turn.end());
  return Done{};
}

Status run(const Arguments& a) {
  const bool cyclictest = program_exists("cyclictest");
  if (!cyclictest)
    fmt::print(stderr,
               "no cyclictest (package rt-tests): the servo is measured alone, and compared with nothing\n");
  const std::string load_before = load_average();
  PALPATE_ASSIGN(Scene scene, make_scene(a));
  const int cpus = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  std::vector<Row> rows;
  for (const std::int64_t rate : a.rates)
    for (const std::string& load : a.loads)
      PALPATE_TRY(measure(a, scene, rate, load, cyclictest, cpus, rows));
  print(rows);
  const std::string load_after = load_average();
  fmt::print("load averages of the machine before and after: {}; {}\n", load_before, load_after);
  for (const Row& row : rows)
    if (row.who != "cyclictest") {
      fmt::print("servo: {}{}\n", row.mode, a.spin ? ", the last of each wait awake" : "");
      break;
    }
  if (a.json.empty()) return Done{};
  Json list = Json::array();
  for (const Row& row : rows) list.push_back(json_of(row));
  const Json document = {{"schema", "palpate.servo-jitter/1"},
                         {"seconds", a.seconds},
                         {"slice_s", a.slice},
                         {"points", a.points},
                         {"spin", a.spin},
                         {"load_average_before", load_before},
                         {"load_average_after", load_after},
                         {"rows", list}};
  return write_file(a.json, document.dump(1) + "\n");
}

}  // namespace

int main(int argc, char** argv) {
  const Result<Arguments> arguments = read_arguments(argc, argv);
  if (!arguments) {
    fmt::print(stderr, "servo_jitter: {}\n", arguments.error().message());
    return 2;
  }
  const Status done = run(*arguments);
  if (done) return 0;
  fmt::print(stderr, "servo_jitter: {}\n", done.error().message());
  return 1;
}
