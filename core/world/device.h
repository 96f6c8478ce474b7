// SPDX-License-Identifier: Apache-2.0
// Embree's device and its errors.
#pragma once

#include "core/plugin/embree.h"

#include <memory>
#include <mutex>
#include <string>

namespace marram {

struct DeviceErrors { // only the first error
    std::mutex lock;
    RTCError code = RTC_ERROR_NONE;
    std::string text;
};

// A device that reports errors to `errors`, and keeps it alive. Throws InputError and std::bad_alloc.
std::shared_ptr<RTCDeviceTy> make_device(std::shared_ptr<DeviceErrors>& errors);

// Clears the reported error.
void clear_errors(DeviceErrors& errors);

// Throws the reported error, if any: InputError or Cancelled.
void raise(DeviceErrors& errors);

} // namespace marram
