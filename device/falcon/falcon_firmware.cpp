#include "device/falcon/falcon_firmware.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <optional>
#include <system_error>
#include <utility>

#include "toolkit/core/input_file.h"
#include "toolkit/core/sha256.h"
#include "toolkit/core/try.h"

namespace palpate::device {
namespace {

constexpr std::size_t kKeyBytes = 2, kReservedBytes = 16, kWordBytes = 2, kAddressBytes = 4;
constexpr std::uint8_t kKeyFirst = 0xAA, kKeySecond = 0x08;
// A C28x has 22 address lines.
constexpr std::uint32_t kMostAddress = 0x3FFFFF;
constexpr unsigned kWordBits = 16, kByteBits = 8;
constexpr const char* kWhatIsAnImage =
    "give an image of the Falcon's firmware as its maker's driver holds it, unchanged";

struct KnownImage {
  const char* name;
  const char* sha256_begins;
};
// Those that libnifalcon's users have, in the order of preference.
constexpr std::array<KnownImage, 4> kKnown = {{{"nvent_firmware.bin", "1119e39c39fab1f3"},
                                               {"test_firmware.bin", "b2700d5cd5ca217e"},
                                               {"novint_T2.bin", "e0ae3598670fa1c8"},
                                               {"novint_T0.bin", "ae838730af34b582"}}};

/// How early it comes among others; kKnown.size(): unknown.
std::size_t rank_of(const std::string& sha256) {
  const auto* at = std::find_if(kKnown.begin(), kKnown.end(), [&](const KnownImage& image) {
    return sha256.starts_with(image.sha256_begins);
  });
  return static_cast<std::size_t>(at - kKnown.begin());
}

/// Reads words in order; nothing past the end.
class WordReader {
 public:
  WordReader(std::span<const std::uint8_t> bytes, std::size_t at) : bytes_(bytes), at_(at) {}
  [[nodiscard]] std::size_t at() const { return at_; }
  [[nodiscard]] std::size_t left() const { return bytes_.size() - at_; }
  void skip(std::size_t bytes) { at_ += bytes; }
  [[nodiscard]] std::optional<std::uint32_t> word() {
    if (left() < kWordBytes) return std::nullopt;
    const std::uint32_t value = bytes_[at_] | (std::uint32_t{bytes_[at_ + 1]} << kByteBits);
    at_ += kWordBytes;
    return value;
  }
  [[nodiscard]] std::optional<std::uint32_t> address() {
    if (left() < kAddressBytes) return std::nullopt;
    const std::uint32_t upper = *word();
    return (upper << kWordBits) | *word();
  }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t at_;
};

Error no_image(const std::string& what, std::size_t at) {
  return {"this is no firmware of a Falcon: " + what + " at byte " + std::to_string(at), kWhatIsAnImage, "",
          0};
}

/// The blocks up to the end of the file.
Status walk_blocks(WordReader& reader, FalconFirmware& image) {
  for (;;) {
    const std::size_t begins = reader.at();
    const std::optional<std::uint32_t> count = reader.word();
    if (!count) return no_image("the file ends where a block's length is due,", begins);
    if (*count == 0) break;
    const std::optional<std::uint32_t> address = reader.address();
    if (!address) return no_image("the file ends within a block's head,", begins);
    if (*address > kMostAddress || *count - 1 > kMostAddress - *address)
      return no_image("a block goes to addresses that the processor does not have,", begins);
    if (reader.left() < kWordBytes * *count) return no_image("the file ends within a block", begins);
    reader.skip(kWordBytes * *count);
    ++image.blocks;
    image.words += *count;
  }
  if (image.blocks == 0) return no_image("it holds no block; the list ends", reader.at());
  if (reader.left() > 0) return no_image("bytes after the end,", reader.at());
  return Done{};
}

std::string variable_of(const char* name) {
  const char* value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): before any thread
  return value == nullptr ? std::string() : std::string(value);
}

/// What a folder holds: the best image, or what is wrong with the first that is none.
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

}  // namespace

Result<FalconFirmware> check_falcon_firmware(std::vector<std::uint8_t> bytes) {
  FalconFirmware image;
  if (bytes.size() < kKeyBytes || bytes[0] != kKeyFirst || bytes[1] != kKeySecond)
    return no_image("the key AA 08 is missing", 0);
  if (bytes.size() < kKeyBytes + kReservedBytes + kAddressBytes)
    return no_image("the file ends within its head,", bytes.size());
  WordReader reader(bytes, kKeyBytes + kReservedBytes);
  image.entry = reader.address().value_or(0);
  if (image.entry > kMostAddress)
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
                   where + ", or run once since power-up a program that loads it",
               "", 0};
}

}  // namespace palpate::device
