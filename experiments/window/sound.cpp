#include "experiments/window/sound.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#ifdef PALPATE_WITH_SOUND
#include <SDL2/SDL.h>
#endif

namespace palpate::experiments {

void ForceTone::fill(std::span<std::int16_t> samples, double share) noexcept {
  constexpr double kFull = 32'767.0;
  const double wanted = std::isfinite(share) ? std::clamp(share, 0.0, 1.0) : 0.0;
  const double follows = 1.0 - std::exp(-1.0 / (kFollowS * kRateHz));
  for (std::int16_t& sample : samples) {
    level_ += follows * (wanted - level_);
    // Linear in pitch.
    const double hz = kLowestHz * std::pow(kHighestHz / kLowestHz, level_);
    phase_ += hz / kRateHz;
    phase_ -= std::floor(phase_);
    sample = static_cast<std::int16_t>(
        std::lround(kFull * kLoudest * level_ * std::sin(2.0 * std::numbers::pi * phase_)));
  }
}

#ifdef PALPATE_WITH_SOUND

namespace {

class SdlSound final : public Sound {
 public:
  SdlSound(const std::atomic<float>& force_n, double limit_n) : force_n_(force_n), limit_n_(limit_n) {}
  ~SdlSound() override {
    if (device_ != 0) SDL_CloseAudioDevice(device_);
    if (begun_) SDL_QuitSubSystem(SDL_INIT_AUDIO);
  }
  Status start() {
    constexpr std::uint16_t kSamplesAtOnce = 512;  // 11 ms: with more delay touch and tone separate
    if (SDL_InitSubSystem(SDL_INIT_AUDIO) != 0) return no_sound();
    begun_ = true;
    SDL_AudioSpec wanted{};
    wanted.freq = ForceTone::kRateHz;
    wanted.format = AUDIO_S16SYS;
    wanted.channels = 1;
    wanted.samples = kSamplesAtOnce;
    wanted.callback = [](void* self, Uint8* bytes, int count) {
      static_cast<SdlSound*>(self)->play(bytes, count);
    };
    wanted.userdata = this;
    device_ = SDL_OpenAudioDevice(nullptr, 0, &wanted, nullptr, 0);
    if (device_ == 0) return no_sound();
    SDL_PauseAudioDevice(device_, 0);
    return Done{};
  }

 private:
  static Error no_sound() {
    return Error{std::string("no sound can be played: ") + SDL_GetError(), "connect an audio device"};
  }
  void play(Uint8* bytes, int count) noexcept {
    auto* const samples = reinterpret_cast<std::int16_t*>(bytes);  // NOLINT: aligned by SDL, of our format
    tone_.fill({samples, static_cast<std::size_t>(count) / sizeof(std::int16_t)},
               static_cast<double>(force_n_.load(std::memory_order_relaxed)) / limit_n_);
  }
  const std::atomic<float>& force_n_;
  double limit_n_;
  ForceTone tone_;
  SDL_AudioDeviceID device_ = 0;
  bool begun_ = false;
};

}  // namespace

Result<std::unique_ptr<Sound>> Sound::open(const std::atomic<float>& force_n, double limit_n) {
  auto sound = std::make_unique<SdlSound>(force_n, limit_n);
  if (const Status started = sound->start(); !started) return started.error();
  return std::unique_ptr<Sound>(std::move(sound));
}

#else

Result<std::unique_ptr<Sound>> Sound::open(const std::atomic<float>&, double) {
  return Error{"this program was built without sound", "install Debian's libsdl2-dev and configure again"};
}

#endif

}  // namespace palpate::experiments
