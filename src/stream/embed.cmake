# SPDX-License-Identifier: Apache-2.0
# cmake -DINPUT=file -DOUTPUT=header -DNAME=kName -P embed.cmake: the bytes of a file as a constant array.
file(READ ${INPUT} hex HEX)
string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${hex}")
string(REGEX REPLACE "(0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,)" "\\1\n" bytes "${bytes}")
file(WRITE ${OUTPUT} "#pragma once\nnamespace stillmap::stream {\ninline constexpr unsigned char ${NAME}[] = {\n${bytes}};\n}\n")
