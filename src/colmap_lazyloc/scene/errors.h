#pragma once

#include <stdexcept>
#include <string>
#include <utility>

namespace lazyloc {

// Thrown if a file or an option of the user cannot be used. The message is one line that names it. The command prints
// it and ends with exit code 1 without any output.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Thrown if one record of the database is damaged, so that only the queries that need this record cannot be localized.
class DamagedRecordError : public InputError {
 public:
  // damage: the record and what is wrong, for example `table keypoints, image 3 (a.jpg): keypoint 7 is not finite`.
  DamagedRecordError(const std::string& database_path, std::string damage)
      : InputError(database_path + ": " + damage), damage_(std::move(damage)) {}

  // Returns the message without the path of the database.
  const std::string& Damage() const { return damage_; }

 private:
  std::string damage_;
};

}  // namespace lazyloc

// Throws std::logic_error if the condition does not hold, because that is a bug in this program.
#define LAZYLOC_CHECK(condition) \
  (static_cast<bool>(condition) ? void(0) : throw std::logic_error(__FILE__ ": check failed: " #condition))
