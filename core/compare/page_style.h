// SPDX-License-Identifier: Apache-2.0
// Style and script of the comparison page.
#pragma once

namespace marram::page {

extern const char* const style;  // a <style>
extern const char* const script; // a <script>, to be placed after the elements it uses

} // namespace marram::page
