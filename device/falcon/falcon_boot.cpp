#include "device/falcon/falcon_boot.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <optional>
#include <span>
#include <system_error>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "device/falcon/falcon_packets.h"
#include "toolkit/core/bytes.h"
#include "toolkit/core/files.h"
#include "toolkit/core/hash.h"

namespace palpate::device {
namespace {

constexpr std::size_t kKeyBytes = 2, kReservedBytes = 16, kWordBytes = 2, kAddressBytes = 4;
constexpr std::uint8_t kKeyFirst = 0xAA, kKeySecond = 0x08;
// A C28x has 22 address lines.
constexpr std::uint32_t kMaxAddress = 0x3FFFFF;
constexpr unsigned kWordBits = 16;
constexpr const char* kWhatIsAnImage =
    "give an image of the Falcon's firmware as its maker's driver holds it, unchanged";

struct KnownImage {
  const char* name;
  const char* sha256_begins;
};
// Images of libnifalcon's users, in order of preference.
constexpr std::array<KnownImage, 4> kKnown = {{{"nvent_firmware.bin", "1119e39c39fab1f3"},
                                               {"test_firmware.bin", "b2700d5cd5ca217e"},
                                               {"novint_T2.bin", "e0ae3598670fa1c8"},
                                               {"novint_T0.bin", "ae838730af34b582"}}};

/// Rank by preference; kKnown.size(): unknown.
std::size_t rank_of(const std::string& sha256) {
  const auto* at = std::find_if(kKnown.begin(), kKnown.end(), [&](const KnownImage& image) {
    return sha256.starts_with(image.sha256_begins);
  });
  return static_cast<std::size_t>(at - kKnown.begin());
}

/// An address of the processor: the upper word comes first.
std::uint32_t read_address(ByteReader& reader) {
  const std::uint32_t upper = reader.u16();
  return (upper << kWordBits) | reader.u16();
}

Error no_image(const std::string& what, std::size_t at) {
  return {"this is no firmware of a Falcon: " + what + " at byte " + std::to_string(at), kWhatIsAnImage, "",
          0};
}

Status walk_blocks(ByteReader& reader, FalconFirmware& image) {
  for (;;) {
    const std::size_t begins = reader.at();
    const std::uint32_t count = reader.u16();
    if (!reader.good()) return no_image("the file ends where a block's length is due,", begins);
    if (count == 0) break;
    const std::uint32_t address = read_address(reader);
    if (!reader.good()) return no_image("the file ends within a block's head,", begins);
    if (address > kMaxAddress || count - 1 > kMaxAddress - address)
      return no_image("a block goes to addresses that the processor does not have,", begins);
    if (reader.raw(kWordBytes * count).empty()) return no_image("the file ends within a block", begins);
    ++image.blocks;
    image.words += count;
  }
  if (image.blocks == 0) return no_image("it holds no block; the list ends", reader.at());
  if (reader.left() > 0) return no_image("bytes after the end,", reader.at());
  return Done{};
}

std::string variable_of(const char* name) {
  const char* value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): before any thread
  return value == nullptr ? std::string() : std::string(value);
}

/// Content of a folder: the best image, or the fault of the first invalid file.
struct InFolder {
  std::optional<FalconFirmware> best;
  std::optional<Error> wrong;
};

InFolder look_into(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  std::error_code failed;
  for (std::filesystem::directory_iterator at(folder, failed), end; !failed && at != end;
       at.increment(failed))
    if (at->path().extension() == ".bin") files.push_back(at->path());
  std::sort(files.begin(), files.end());
  InFolder found;
  for (const std::filesystem::path& file : files) {
    Result<FalconFirmware> image = read_falcon_firmware(file.string());
    if (!image) {
      if (!found.wrong) found.wrong = std::move(image).error();
    } else if (!found.best || rank_of(image->sha256) < rank_of(found.best->sha256)) {
      found.best = std::move(image).value();
    }
  }
  return found;
}

constexpr const char* kFalconName = "falcon";

// FTDI requests (application note AN232B-04 and public drivers).
constexpr std::uint8_t kVendorOut = 0x40;
constexpr std::uint8_t kPurge = 0x00, kModem = 0x01, kFlow = 0x02, kBaud = 0x03, kLine = 0x04, kEvent = 0x06,
                       kLatency = 0x09;
constexpr std::uint16_t kPurgeRx = 1, kPurgeTx = 2;
constexpr std::uint16_t kDtrLow = 0x0100, kDtrHigh = 0x0101, kRtsLow = 0x0200;
constexpr std::uint16_t kNoFlow = 0, kLine8N1 = 0x0008;
constexpr std::uint16_t kBaudRom = 0x4138, kBaudLoading = 0x0015, kBaudPackets = 0x0002;
constexpr std::uint16_t kLatencyLoading = 16, kLatencyPackets = 1;  // ms
constexpr std::uint16_t kEventOff = 0, kEventOn = 0x013E;           // '>' and its enable bit

constexpr std::size_t kMaxPacket = 64;
constexpr std::size_t kChunk = 62;  // capacity of one echo packet
constexpr std::uint8_t kAutobaud = 0x41;
constexpr std::array<std::uint8_t, 3> kHello = {0x0A, 0x43, 0x0D};
constexpr std::array<std::uint8_t, 4> kHelloAnswer = {0x0A, 0x44, 0x2C, 0x0D};

constexpr int kHelloTries = 100;
constexpr int kHelloMs = 50;    // 4 bytes at 9600 baud take 4 ms, the chip's timer 16
constexpr int kEchoMs = 250;    // 62 bytes take 5 ms, the timer 16; the rest allows for a busy machine
constexpr int kSubmitMs = 250;  // timeout of a full queue
constexpr int kUploads = 10;
// Replies may be lost: 10 rounds of 100 packets, 2 ms each, twice the chip's timer.
constexpr int kProbeRounds = 10, kProbeTries = 100, kProbeMs = 2;

/// The FTDI chip: control requests, outgoing bytes, incoming payload.
class FtdiLine {
 public:
  FtdiLine(ControlLink& link, const FalconBoot& boot) : link_(link), boot_(boot) {}

  Status set(std::uint8_t request, std::uint16_t value) {
    return link_.control({kVendorOut, request, value, 0});
  }
  Status purge() {
    PALPATE_TRY(set(kPurge, kPurgeRx));
    PALPATE_TRY(set(kPurge, kPurgeTx));
    // Discards what the link holds; bounded, as a device may send without end.
    for (std::size_t i = 0; i < kMaxStale && read().has_value(); ++i) payload_ = {};
    return gone_ ? Status(gone()) : Status(Done{});
  }
  Status write(std::span<const std::uint8_t> bytes) {
    for (int ms = 0; !link_.submit(bytes); ++ms) {
      if (gone_ || ms == kSubmitMs)
        return Error{"the Falcon takes no bytes", "unplug it, plug it in again, and look at its power",
                     kFalconName};
      boot_.pause(1);
    }
    return Done{};
  }
  std::optional<std::uint8_t> read() {
    for (int packets = 0; payload_.empty() && packets < kMaxEmptyPackets; ++packets) {
      const Polled polled = link_.poll(packet_);
      gone_ = gone_ || polled.gone;
      if (polled.size == 0) return std::nullopt;
      payload_ = ftdi_payload(std::span(packet_).first(polled.size));
    }
    if (payload_.empty()) return std::nullopt;
    const std::uint8_t byte = payload_.front();
    payload_ = payload_.subspan(1);
    return byte;
  }
  /// Waits for a byte; `left_ms` counts down over several calls.
  std::optional<std::uint8_t> await(int& left_ms) {
    for (;;) {
      if (const auto byte = read()) return byte;
      if (gone_ || left_ms <= 0) return std::nullopt;
      boot_.pause(1);
      --left_ms;
    }
  }
  [[nodiscard]] bool is_gone() const { return gone_; }
  static Error gone() {
    return {"the Falcon was unplugged while it was being set up", "plug it in again", kFalconName, 0};
  }

 private:
  static constexpr std::size_t kMaxStale = 4096;  // bytes: more than a link's ring holds
  static constexpr int kMaxEmptyPackets = 64;     // one second at 16 ms

  ControlLink& link_;
  const FalconBoot& boot_;
  std::array<std::uint8_t, kMaxPacket> packet_{};
  std::span<const std::uint8_t> payload_;
  bool gone_ = false;
};

Status set_all(FtdiLine& line, std::initializer_list<std::pair<std::uint8_t, std::uint16_t>> settings) {
  for (const auto& [request, value] : settings) PALPATE_TRY(line.set(request, value));
  return Done{};
}

Status set_for_packets(FtdiLine& line, bool event_character) {
  PALPATE_TRY(set_all(line, {{kLatency, kLatencyPackets},
                             {kBaud, kBaudPackets},
                             {kLine, kLine8N1},
                             {kFlow, kNoFlow},
                             {kEvent, event_character ? kEventOn : kEventOff}}));
  return line.purge();
}

Result<bool> firmware_runs(FtdiLine& line, const FalconBoot& boot) {
  const FalconBytes zero = encoded(FalconCommand{});
  for (int round = 0; round < kProbeRounds; ++round) {
    PALPATE_TRY(set_for_packets(line, boot.event_character));
    FalconReader reader;
    for (int tries = 0; tries < kProbeTries; ++tries) {
      PALPATE_TRY(line.write(zero));
      int left_ms = kProbeMs;
      while (const auto byte = line.await(left_ms))
        if (reader.take(*byte)) return true;
      if (line.is_gone()) return FtdiLine::gone();
    }
  }
  return false;
}

Error no_answer(const char* what) {
  return {std::string("the Falcon's boot ROM ") + what,
          "switch the Falcon off and on, and plug it in without a hub", kFalconName, 0};
}

/// Resets the processor and waits until its boot ROM answers.
Status wake_rom(FtdiLine& line) {
  PALPATE_TRY(set_all(line, {{kEvent, kEventOff},
                             {kLatency, kLatencyLoading},
                             {kBaud, kBaudRom},
                             {kLine, kLine8N1},
                             {kFlow, kNoFlow},
                             {kModem, kRtsLow},
                             {kModem, kDtrLow},
                             {kModem, kDtrHigh}}));
  PALPATE_TRY(line.purge());
  for (int tries = 0; tries < kHelloTries; ++tries) {
    PALPATE_TRY(line.write(kHello));
    int left_ms = kHelloMs;
    // Some hosts see a zero before the answer: only its end counts.
    std::size_t matched = 0;
    while (const auto byte = line.await(left_ms)) {
      matched = *byte == kHelloAnswer[matched] ? matched + 1 : (*byte == kHelloAnswer[0] ? 1U : 0U);
      if (matched == kHelloAnswer.size()) return Done{};
    }
    if (line.is_gone()) return FtdiLine::gone();
  }
  return no_answer("does not answer");
}

/// Sends the image and compares each byte with its echo.
Status load(FtdiLine& line, const FalconFirmware& image) {
  PALPATE_TRY(set_all(line, {{kModem, kDtrLow}, {kBaud, kBaudLoading}}));
  PALPATE_TRY(line.purge());
  PALPATE_TRY(line.write(std::span(&kAutobaud, 1)));
  int left_ms = kEchoMs;
  for (;;) {  // late answers to a greeting may come first
    const auto byte = line.await(left_ms);
    if (!byte) return line.is_gone() ? FtdiLine::gone() : no_answer("does not take the rate for loading");
    if (*byte == kAutobaud) break;
  }
  const std::span<const std::uint8_t> bytes(image.bytes);
  for (std::size_t at = 0; at < bytes.size(); at += kChunk) {
    const std::span<const std::uint8_t> chunk = bytes.subspan(at, std::min(kChunk, bytes.size() - at));
    PALPATE_TRY(line.write(chunk));
    left_ms = kEchoMs;
    for (const std::uint8_t sent : chunk) {
      const auto echo = line.await(left_ms);
      if (!echo) return line.is_gone() ? FtdiLine::gone() : no_answer("stopped echoing the image");
      if (*echo != sent) return no_answer("echoed a byte of the image wrongly");
    }
  }
  return Done{};
}

}  // namespace

Result<FalconFirmware> check_falcon_firmware(std::vector<std::uint8_t> bytes) {
  FalconFirmware image;
  if (bytes.size() < kKeyBytes || bytes[0] != kKeyFirst || bytes[1] != kKeySecond)
    return no_image("the key AA 08 is missing", 0);
  if (bytes.size() < kKeyBytes + kReservedBytes + kAddressBytes)
    return no_image("the file ends within its head,", bytes.size());
  ByteReader reader{std::span<const std::uint8_t>(bytes)};
  (void)reader.raw(kKeyBytes + kReservedBytes);
  image.entry = read_address(reader);
  if (image.entry > kMaxAddress)
    return no_image("its entry is an address that the processor does not have,", kKeyBytes + kReservedBytes);
  PALPATE_TRY(walk_blocks(reader, image));
  image.sha256 = sha256_of(std::as_bytes(std::span(bytes)));
  const std::size_t rank = rank_of(image.sha256);
  image.name = rank < kKnown.size() ? kKnown[rank].name : "unknown image";
  image.bytes = std::move(bytes);
  return image;
}

Result<FalconFirmware> read_falcon_firmware(const std::string& path) {
  PALPATE_ASSIGN(const std::string text, read_file(path, kFalconMostFirmwareBytes));
  Result<FalconFirmware> image = check_falcon_firmware(std::vector<std::uint8_t>(text.begin(), text.end()));
  if (!image) return std::move(image).error().in_file(path);
  image->path = path;
  return image;
}

FalconFirmwarePlaces falcon_firmware_places(const std::string& file) {
  FalconFirmwarePlaces places{file, variable_of("PALPATE_FALCON_FIRMWARE"), {}};
  const std::string data = variable_of("XDG_DATA_HOME"), home = variable_of("HOME");
  const std::filesystem::path own = std::filesystem::path("palpate") / "falcon";
  if (!data.empty())
    places.folders.push_back(std::filesystem::path(data) / own);
  else if (!home.empty())
    places.folders.push_back(std::filesystem::path(home) / ".local" / "share" / own);
  places.folders.push_back(std::filesystem::path("/usr/local/share") / own);
  places.folders.emplace_back("/lib/firmware/novint");
  return places;
}

Result<FalconFirmware> find_falcon_firmware(const FalconFirmwarePlaces& places) {
  if (!places.file.empty()) return read_falcon_firmware(places.file);
  if (!places.variable.empty()) return read_falcon_firmware(places.variable);
  std::optional<Error> wrong;
  for (const std::filesystem::path& folder : places.folders) {
    InFolder found = look_into(folder);
    if (found.best) return *std::move(found.best);
    if (found.wrong && !wrong) wrong = std::move(found.wrong);
  }
  if (wrong) return *std::move(wrong);
  std::string where;
  for (const std::filesystem::path& folder : places.folders)
    where += (where.empty() ? "" : ", ") + folder.string();
  return Error{"the Falcon has no firmware running, and no image of it was found",
               "Palpate may not ship one. Name a file of yours with --device-option firmware=FILE or "
               "PALPATE_FALCON_FIRMWARE, or put it into one of " +
                   where + ", or run once since power-up a program that loads it"};
}

Result<FalconBooted> boot_falcon(ControlLink& link, const FalconBoot& boot) {
  FalconBooted booted;
  {
    FtdiLine line(link, boot);
    PALPATE_ASSIGN(booted.was_running, firmware_runs(line, boot));
    if (booted.was_running) return booted;
  }
  PALPATE_ASSIGN(const FalconFirmware image, boot.firmware());
  booted.firmware = image.name;
  booted.sha256 = image.sha256;
  for (;;) {
    ++booted.attempts;
    FtdiLine line(link, boot);
    Status loaded = wake_rom(line);
    if (loaded) loaded = load(line, image);
    if (loaded) {
      PALPATE_ASSIGN(const bool runs, firmware_runs(line, boot));
      if (runs) return booted;
      loaded = Error{"the image was loaded, but does not answer packets",
                     "try another image of the Falcon's firmware", image.path};
    }
    if (line.is_gone() || booted.attempts == kUploads) return std::move(loaded).error();
    link.close();
    PALPATE_TRY(link.open());
  }
}

}  // namespace palpate::device
