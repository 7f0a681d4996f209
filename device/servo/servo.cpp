#include <palpate/device/servo.h>

#include <time.h>

#include <utility>

#include <palpate/result.h>

namespace palpate::device {
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
