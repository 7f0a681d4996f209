#include <time.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include <palpate/device/loop_histogram.h>
#include <palpate/device/servo.h>
#include <palpate/device/servo_loop.h>
#include <palpate/result.h>

namespace palpate::device {
namespace {

constexpr std::size_t kBinsAStretch = DurationHistogram::kPerOctave / 4;

constexpr std::int64_t kNsPerS = 1'000'000'000;

}  // namespace

std::uint64_t DurationHistogram::copy(Counts& counts) const noexcept {
  std::uint64_t total = 0;
  for (std::size_t i = 0; i < kBins; ++i) {
    counts[i] = bins_[i].load(std::memory_order_acquire);
    total += counts[i];
  }
  return total;
}

std::int64_t DurationHistogram::percentile_of(const Counts& counts, std::uint64_t total,
                                              double share) const noexcept {
  if (total == 0) return 0;
  const double wanted = std::ceil(std::clamp(share, 0.0, 1.0) * static_cast<double>(total));
  const std::uint64_t rank = std::clamp<std::uint64_t>(static_cast<std::uint64_t>(wanted), 1, total);
  const std::uint64_t most = max_.load(std::memory_order_relaxed);
  std::uint64_t below = 0;
  for (std::size_t i = 0; i < kBins; ++i) {
    below += counts[i];
    // The last bin is unbounded.
    if (below >= rank) return static_cast<std::int64_t>(i + 1 == kBins ? most : std::min(top_of(i), most));
  }
  return static_cast<std::int64_t>(most);
}

std::vector<DurationBin> DurationHistogram::bins() const {
  Counts counts;
  if (copy(counts) == 0) return {};
  std::vector<DurationBin> all;
  std::size_t used = 0;
  for (std::size_t first = 0; first < kBins; first += kBinsAStretch) {
    const std::size_t last = std::min(first + kBinsAStretch, kBins) - 1;
    DurationBin bin{first == 0 ? 0 : static_cast<std::int64_t>(top_of(first - 1)) + 1,
                    static_cast<std::int64_t>(top_of(last)), 0};
    for (std::size_t i = first; i <= last; ++i) bin.count += counts[i];
    if (bin.count == 0 && all.empty()) continue;
    all.push_back(bin);
    if (bin.count > 0) used = all.size();
  }
  all.resize(used);
  return all;
}

DurationStatistics DurationHistogram::statistics() const noexcept {
  Counts counts;
  DurationStatistics found;
  found.count = copy(counts);
  if (found.count == 0) return found;
  found.min_ns = static_cast<std::int64_t>(min_.load(std::memory_order_relaxed));
  found.p50_ns = percentile_of(counts, found.count, 0.5);
  found.p99_ns = percentile_of(counts, found.count, 0.99);
  found.p999_ns = percentile_of(counts, found.count, 0.999);
  found.max_ns = static_cast<std::int64_t>(max_.load(std::memory_order_relaxed));
  found.mean_ns =
      static_cast<double>(sum_.load(std::memory_order_relaxed)) / static_cast<double>(found.count);
  return found;
}

LoopStatistics LoopHistograms::statistics() const noexcept {
  LoopStatistics found;
  found.missed = missed();
  found.overruns = overruns();
  found.page_faults = {minor_faults_.load(std::memory_order_acquire),
                       major_faults_.load(std::memory_order_acquire)};
  found.lateness = lateness.statistics();
  found.step = step.statistics();
  found.exchange = exchange.statistics();
  found.period = period.statistics();
  found.ticks = found.lateness.count;
  return found;
}

// Splits whole seconds from the rest, so nothing overflows in any session.
std::int64_t DueTimes::at(std::int64_t tick) const noexcept {
  return first_ns_ + tick / rate_hz_ * kNsPerS + tick % rate_hz_ * kNsPerS / rate_hz_;
}

std::int64_t DueTimes::period_ns() const noexcept {
  return kNsPerS / rate_hz_;
}

std::uint64_t DueTimes::take(std::int64_t now_ns) noexcept {
  const std::int64_t due = next_++;
  const std::int64_t elapsed_ns = now_ns - first_ns_;
  if (now_ns < at(next_)) return 0;
  // The last due tick: the largest k with floor(k 10^9 / rate) <= elapsed, so k 10^9 / rate < elapsed + 1.
  const std::int64_t rest_ns = elapsed_ns % kNsPerS;
  const std::int64_t last =
      elapsed_ns / kNsPerS * rate_hz_ + ((rest_ns + 1) * rate_hz_ + kNsPerS - 1) / kNsPerS - 1;
  next_ = last + 1;
  return static_cast<std::uint64_t>(last - due);
}

Result<std::unique_ptr<ServoLoop>> ServoLoop::create(Servo& servo, const Clock& clock, std::int64_t rate_hz,
                                                     std::span<TickObserver* const> observers) {
  if (rate_hz < kMinServoHz || rate_hz > kMaxServoHz)
    return Error{"the servo's rate is " + std::to_string(rate_hz) + " Hz",
                 "give " + std::to_string(kMinServoHz) + " to " + std::to_string(kMaxServoHz) + " Hz"};
  if (observers.size() > kMaxObservers)
    return Error{"the servo has " + std::to_string(observers.size()) + " observers",
                 "give at most " + std::to_string(kMaxObservers)};
  return std::unique_ptr<ServoLoop>(new ServoLoop(servo, clock, rate_hz, observers));
}

ServoLoop::ServoLoop(Servo& servo, const Clock& clock, std::int64_t rate_hz,
                     std::span<TickObserver* const> observers) noexcept
    : servo_(servo), clock_(clock), due_(rate_hz), observers_count_(observers.size()) {
  std::copy(observers.begin(), observers.end(), observers_.begin());
}

void ServoLoop::count(const Tick& tick, std::int64_t began_ns) noexcept {
  histograms_.lateness.count(began_ns - tick.due_ns);
  if (tick.missed > 0) histograms_.miss(tick.missed);
  histograms_.exchange.count(tick.exchange_ns);
  if (has_before_) histograms_.period.count(began_ns - before_ns_);
  before_ns_ = began_ns;
  // A restart's time is neither a frame's nor a period's.
  has_before_ = !tick.restarted;
  if (tick.step_ns > 0 && !tick.restarted) histograms_.step.count(tick.step_ns);
}

Tick ServoLoop::tick() noexcept {
  const std::int64_t began_ns = clock_.now_ns();
  const std::int64_t due_ns = due_.due_ns();
  const std::uint64_t missed = due_.take(began_ns);
  if (rearm_.load(std::memory_order_relaxed) && rearm_.exchange(false, std::memory_order_acquire))
    servo_.rearm();
  Tick tick = servo_.tick();
  tick.due_ns = due_ns;
  tick.missed = missed;
  count(tick, began_ns);
  for (std::size_t i = 0; i < observers_count_; ++i) observers_[i]->took(tick);
  const std::int64_t ended_ns = clock_.now_ns();
  if (tick.restarted)
    due_.begin(ended_ns + due_.period_ns());
  else if (ended_ns - began_ns > due_.period_ns())
    histograms_.overrun();
  return tick;
}

namespace {

// Time for a tick under way to send when the program stops: two periods at the slowest rate.
constexpr timespec kUnderWay{0, 4'000'000};

}  // namespace

Status Servo::start(const std::optional<Vec3>& free_mm) {
  stop();
  PALPATE_TRY(device_.open());
  Result<ForceGovernor> made = ForceGovernor::create(device_.limits(), options_);
  if (!made) {
    device_.close();
    return std::move(made).error().in_file(device_.name());
  }
  governor_.emplace(std::move(made).value());
  started_ = true;
  stop_callback_ = StopCallback([this] {
    halt();
    return std::string();
  });
  last_free_mm_ = free_mm;
  // A period before the first tick: the bring-up goes on from there.
  if (free_mm) renderer_.restart(*free_mm, clock_.now_s() - options_.period_s);
  rearm();
  return Done{};
}

void Servo::rearm() noexcept {
  if (!started_) return;
  placed_ = false;
  rearmed_ = true;
  catch_up_.abandon();
  if (heart_ != nullptr) heart_->rearm();
  governor_->arm(clock_.now_s());
}

void Servo::stop() noexcept {
  end();
  stop_callback_.drop();
}

void Servo::end() noexcept {
  if (!started_) return;
  started_ = false;
  if (heart_ != nullptr) heart_->rest();
  governor_->disarm();
  device_.send(governor_->zero());
  device_.close();
}

/// The program is about to end; this is not the servo's thread.
void Servo::halt() noexcept {
  halted_.store(true, std::memory_order_release);
  if (!device_.cut_force()) return;
  ::nanosleep(&kUnderWay, nullptr);
  device_.cut_force();
}

bool Servo::given_up() const noexcept {
  return halted_.load(std::memory_order_acquire) || (heart_ != nullptr && heart_->tripped());
}

/// Handles the first valid position after arming. True if the renderer was restarted.
bool Servo::place(const Vec3& hip_mm, double t_s) noexcept {
  placed_ = true;
  const double before_s = t_s - options_.period_s;
  if (last_free_mm_) {
    catch_up_.begin(renderer_, *last_free_mm_, before_s);
    return false;
  }
  if (heart_ != nullptr) heart_->rest();  // no force has been shown yet, and this may take long
  renderer_.restart(hip_mm, before_s);
  if (heart_ != nullptr) heart_->beat();
  governor_->arm(clock_.now_s());  // the restart's time is no lateness
  return true;
}

/// True if the renderer may see the state. Before the first packet there is no position.
bool Servo::usable(const DeviceState& state) const noexcept {
  const bool known =
      state.status == ReadStatus::kFresh || (placed_ && state.status == ReadStatus::kNothingNew);
  return known && state.homed && !governor_->settling() && is_finite(state.position_mm);
}

GovernedForce Servo::govern(const Tick& tick, const Vec3& wanted_n) noexcept {
  if (given_up()) governor_->latch(Fault::kStalled);  // who saw it first says what it was
  GovernedForce governed = governor_->govern(tick.t_s, tick.state, wanted_n);
  // Checked as late as possible: the frame may have taken long.
  if (!given_up()) return governed;
  governor_->latch(Fault::kStalled);
  return governor_->zero();
}

Tick Servo::tick() noexcept {
  Tick tick;
  tick.t_ns = clock_.now_ns();
  tick.t_s = clock_.now_s();
  tick.rearmed = std::exchange(rearmed_, false);
  tick.state = device_.read();
  if (!started_) return tick;
  if (heart_ != nullptr) heart_->beat();
  const std::int64_t read_ns = clock_.now_ns();
  Vec3 wanted_n = Vec3::Zero();
  const bool placed_well = usable(tick.state);
  if (placed_well) tick.hip_mm = map_.world_mm(tick.state.position_mm);
  if (governor_->armed() && !given_up() && placed_well) {
    const Vec3& hip_mm = tick.hip_mm;
    if (!placed_) tick.restarted = place(hip_mm, tick.t_s);
    if (catch_up_.pending()) {
      tick.frame = catch_up_.advance(renderer_, hip_mm, tick.t_s);
    } else {
      tick.frame = renderer_.step(hip_mm, tick.t_s);
    }
    if (catch_up_.pending())
      tick.frame.force_n.setZero();  // on the way, not at the hand
    else if (!tick.frame.contact)
      last_free_mm_ = hip_mm;
    wanted_n = map_.device_n(tick.frame.force_n);
    tick.step_ns = clock_.now_ns() - read_ns;
  }
  GovernedForce governed = govern(tick, wanted_n);
  tick.sent_n = governed.newtons();
  tick.fault = governor_->fault();
  const std::int64_t send_ns = clock_.now_ns();
  device_.send(std::move(governed));
  tick.exchange_ns = (read_ns - tick.t_ns) + (clock_.now_ns() - send_ns);
  return tick;
}

}  // namespace palpate::device
