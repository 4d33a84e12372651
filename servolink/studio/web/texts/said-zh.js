// Messages of the hub, the studio and the doctor in Simplified and in Traditional Chinese, by the English template in the
// module named above. The value of a name in braces is translated too.

/** @type {Record<string, [hans: string, hant: string]>} */
const MESSAGES = {
  // servolink/protocol/record_types.py
  "servo parameter": ["舵机参数", "舵機參數"],
  "action": ["动作", "動作"],
  "macro": ["宏", "巨集"],
  "joystick table": ["按键表", "搖桿定義表"],
  // servolink/studio/page.py
  "studio: {who}": ["工作室：{who}", "studio：{who}"],
  "a page": ["一个页面", "某個頁面"],
  // servolink/hub/methods/context.py
  "the hub": ["hub", "hub"],
  "the hub, for raw angles": ["hub（原始角度）", "hub（原始角度）"],
  "the session has ended; connect again": ["会话已结束，请重新连接", "工作階段已結束，請重新連線"],
  // servolink/hub/engine/hub_gates.py
  "the servos of {name} are moved by {who}, which has had the lease for {time}: wait until it is free, or take it over with `servolink share --take {again}`": ["{name} 的舵机正由 {who} 控制（已 {time}）：请等待释放，或接管控制", "{name} 的舵機正由 {who} 操控（已 {time}）：請等對方交還控制權，或直接接手"],
  "the right to move the servos of {name} was taken from this program: `servolink share --give {again}` gives it back": ["此页面控制 {name} 舵机的权利已被收回，可用命令交还：servolink share --give {again}", "這個頁面操控 {name} 舵機的權利已被收回，可用指令交還：servolink share --give {again}"],
  "{packet} needs the role {needed}, and this program has the role {role}": ["{packet} 需要角色 {needed}，而此页面的角色是 {role}", "{packet} 需要角色 {needed}，而這個頁面的角色是 {role}"],
  "the time by which it was to begin has passed": ["已错过开始的时间", "已錯過應開始的時間"],
  "nothing was moved: {reason}": ["没有移动：{reason}", "沒有移動：{reason}"],
  "nothing was moved: {who} has taken exclusive use of the board": ["没有移动：{who} 正在独占主板", "沒有移動：{who} 正在獨佔控制板"],
  // servolink/hub/doors/direct.py
  "{who} has exclusive use of the board": ["{who} 正在独占主板", "{who} 正在獨佔控制板"],
  // servolink/hub/methods/motion_methods.py
  "nothing was moved: the board was stopped since this was prepared": ["没有移动：准备之后主板被停止了", "沒有移動：準備好之後控制板被停止了"],
  "nothing was moved: the board was connected again since this was prepared": ["没有移动：准备之后主板重新连接了", "沒有移動：準備好之後控制板重新連線了"],
  // servolink/hub/methods/stored.py
  "a record is being changed": ["正在修改一条记录", "正在變更一筆紀錄"],
  "a project is being compared": ["正在比较项目", "正在比較專案"],
  "a project is being written": ["正在写入项目", "正在寫入專案"],
  "a backup is being restored": ["正在恢复备份", "正在還原備份"],
  "the board has no {kind} {id} any more": ["主板上已没有 {kind} {id}", "控制板上已經沒有 {kind} {id}"],
  "the board holds an unfinished import: apply the project again, or roll back": ["主板上有未完成的写入：请重新写入项目，或回滚", "控制板上有未完成的寫入：請重新寫入專案，或還原"],
  "there is no backup {number}; project.backups lists them": ["没有备份 {number}", "沒有備份 {number}"],
  // servolink/hub/methods/methods.py
  "the transmission mode is being set": ["正在设置传输模式", "正在設定傳輸模式"],
  // servolink/hub/engine/stop_order.py
  "{reason}: the board is stopped as soon as it is connected again": ["{reason}：主板重新连接后会立即停止", "{reason}：控制板重新連線後會立即停止"],
  "{reason}: what was asked for before moves nothing": ["{reason}：之前要求的动作不再执行", "{reason}：先前要求的動作不再執行"],
  "a stop was sent {count} times and could not be confirmed": ["停止命令已发送 {count} 次，但无法确认", "停止指令已傳送 {count} 次，但無法確認"],
  "servos {ids} were asked to stop, and do not report that they are stopped": ["已要求舵机 {ids} 停止，但它们没有报告已停止", "已要求舵機 {ids} 停止，但它們沒有回報已停止"],
  // servolink/hub/engine/hub_recorder.py
  "the recording {file} was ended: {reason}": ["记录 {file} 已结束：{reason}", "錄製 {file} 已結束：{reason}"],
  "{file} is being recorded already": ["已经在记录 {file}", "已經在錄製 {file}"],
  "nothing is being recorded": ["没有正在进行的记录", "沒有正在進行的錄製"],
  "cannot record: {reason}": ["无法记录：{reason}", "無法錄製：{reason}"],
  "the disk has only {free} MiB left": ["磁盘只剩 {free} MiB", "磁碟只剩 {free} MiB"],
  // servolink/motion/ticket.py
  "a stop came first": ["已先被停止", "已先被停止"],
  // servolink/motion/movement.py
  "servo {id}: {angle} degrees is outside its limits {limits}": ["舵机 {id}：{angle} 度超出限位 {limits}", "舵機 {id}：{angle} 度超出角度限制 {limits}"],
  "servo {id}: {distance} degrees in {time} s is {speed} degrees/s; its cap is {cap}": ["舵机 {id}：{time} 秒转 {distance} 度即 {speed} 度/秒，上限为 {cap}", "舵機 {id}：{time} 秒轉動 {distance} 度等於每秒 {speed} 度，上限是 {cap}"],
  "servo {id}: limits and speeds are in degrees, and this servo is not set to degrees": ["舵机 {id}：限位和速度以度为单位，而此舵机没有设为度", "舵機 {id}：限制與速度以度為單位，而這顆舵機沒有設為度（Degree）"],
  "the board has no servo {id}; nothing was moved": ["主板没有舵机 {id}，没有移动", "控制板沒有舵機 {id}，沒有移動"],
  "servo {id}: {angle} degrees is beyond ±{turn}, and no limits say that it can turn that far; nothing was sent. Add --any-angle (in Python any_angle=True) if it can": ["舵机 {id}：{angle} 度超过 ±{turn} 度，而没有限位说明它能转这么远；没有发送", "舵機 {id}：{angle} 度超過 ±{turn} 度，而沒有角度限制說明它能轉這麼遠；沒有傳送"],
  "{who} stopped or released and would ignore the movement; nothing was sent. Add --start (in Python start=True, or set_servo before) to start and hold first": ["{who} 已停止或已释放，不会执行动作；没有发送。请先启动并保持", "{who} 已停止或已釋放，不會執行動作；沒有傳送。請先啟動並保持"],
  "servo {id} is": ["舵机 {id}", "舵機 {id}"],
  "servos {ids} are": ["舵机 {ids}", "舵機 {ids}"],
  // servolink/motion/set_points.py
  "servo {id}: its limits {low}..{high} allow no whole angle": ["舵机 {id}：限位 {low} 到 {high} 之间没有整数角度", "舵機 {id}：角度限制 {low} 到 {high} 之間沒有整數角度"],
  // servolink/transports/lifecycle.py
  "{url}: cannot open it: {reason}": ["{url}：无法打开：{reason}", "{url}：無法開啟：{reason}"],
  "{url}: the connection was lost: {reason}": ["{url}：连接断开：{reason}", "{url}：連線中斷：{reason}"],
  "{url}: it was closed while being opened; try again": ["{url}：打开时被关闭，请重试", "{url}：開啟時被關閉，請再試一次"],
  // servolink/transports/serial.py
  "{url}: {reason}": ["{url}：{reason}", "{url}：{reason}"],
  "there is no {device}; plug the board in and switch it on; {present}": ["没有 {device}，请接上主板并打开电源；{present}", "沒有 {device}，請接上控制板並打開電源；{present}"],
  "{device} is in use; close the program that has it (another servolink, a serial monitor, ModemManager)": ["{device} 已被占用，请关闭占用它的程序（其他 servolink、串口监视器、ModemManager）", "{device} 使用中，請關閉佔用它的程式（其他 servolink、序列埠監控視窗、ModemManager）"],
  "no permission for {device}; on Linux join its group, `sudo usermod -aG dialout $USER` (uucp on Arch), then log out and in": ["没有 {device} 的权限；在 Linux 上请加入它的用户组：`sudo usermod -aG dialout $USER`（Arch 为 uucp），然后注销并重新登录", "沒有 {device} 的權限；在 Linux 上請加入它的群組：`sudo usermod -aG dialout $USER`（Arch 是 uucp），然後登出再登入"],
  "{device} is not a serial port; {present}": ["{device} 不是串口；{present}", "{device} 不是序列埠；{present}"],
  "cannot open {device}: {reason}": ["无法打开 {device}：{reason}", "無法開啟 {device}：{reason}"],
  "the device is gone; is it unplugged or switched off?": ["设备已消失：是否被拔下或关闭？", "裝置已消失：是否被拔掉或關閉電源？"],
  "no serial port is here": ["这里没有串口", "這裡沒有序列埠"],
  "the serial ports here: {ports}": ["这里的串口：{ports}", "這裡的序列埠：{ports}"],
  // servolink/transports/serial_ports.py
  "no permission for {device}; `servolink doctor` says how to get it": ["没有 {device} 的权限，处理方法见下", "沒有 {device} 的權限，處理方式如下"],
  // servolink/transports/stream.py
  "no answer within {time} s; check address, network and firewall, or give timeout=SECONDS": ["{time} 秒内没有应答；请检查地址、网络和防火墙", "{time} 秒內沒有回應；請檢查位址、網路與防火牆"],
  "nothing listens on port {port} of {host}; start the bridge or virtual board, or check the port": ["{host} 的端口 {port} 没有程序在监听；请启动网桥或虚拟主板，或检查端口", "{host} 的連接埠 {port} 沒有程式在接聽；請啟動橋接程式或虛擬控制板，或檢查連接埠號碼"],
  "there is no host '{host}'; check the name, or write its IP address": ["没有名为“{host}”的主机；请检查名称，或填写 IP 地址", "沒有名為「{host}」的主機；請檢查名稱，或改填 IP 位址"],
  "cannot connect: {reason}; check address and network": ["无法连接：{reason}；请检查地址和网络", "無法連線：{reason}；請檢查位址與網路"],
  "the other side closed the connection": ["对方关闭了连接", "對方關閉了連線"],
  // servolink/control/channel.py
  "the hub of {name} has not answered {method} within {time} s": ["{name} 的 hub 在 {time} 秒内没有应答 {method}", "{name} 的 hub 在 {time} 秒內沒有回應 {method}"],
  // servolink/studio/robots.py
  "{name} is in exclusive use by {who} ({reason}); change the robot when that is done": ["{who} 正在独占 {name}（{reason}），完成后再更换机器人", "{who} 正在獨佔 {name}（{reason}），完成後再更換機器人"],
  // servolink/studio/studio_methods.py
  "the studio does not use this board any more": ["工作室已不再使用此主板", "studio 已不再使用這塊控制板"],
  // servolink/control/rights.py
  "this page was opened through a link": ["此页面是通过链接打开的", "這個頁面是透過連結開啟的"],
  "use the page on the machine of the studio": ["请使用运行工作室的电脑上的页面", "請改用執行 studio 的電腦上的頁面"],
  // servolink/studio/limit_methods.py
  "the lowest angle is above the highest angle": ["最小角度大于最大角度", "最小角度大於最大角度"],
  "exchange the angles": ["请对调两个角度", "請對調兩個角度"],
  "limits are kept by the name of a board, and this board has no name": ["限位按主板名称保存，而此主板没有名称", "角度限制依控制板的名稱保存，而這塊控制板沒有名稱"],
  // servolink/studio/project_methods.py
  "there is no backup {number}; look at the list of backups again": ["没有备份 {number}，请重新查看备份列表", "沒有備份 {number}，請重新查看備份清單"],
  // servolink/studio/recording_methods.py
  "the recording cannot be read: {reason}": ["无法读取记录文件：{reason}", "無法讀取錄製檔：{reason}"],
  // servolink/studio/kept.py
  "the {kind} of a board cannot be kept: {reason}": ["无法保存主板的 {kind}：{reason}", "無法儲存控制板的 {kind}：{reason}"],
  // servolink/project/validate.py
  "{id} means that an import is under way; choose another id, such as 1": ["{id} 表示正在写入，请换一个编号，例如 1", "{id} 表示正在寫入，請換一個編號，例如 1"],
  "there are {count}; a board can list {most}": ["有 {count} 条，主板最多能列出 {most} 条", "有 {count} 筆，控制板最多能列出 {most} 筆"],
  "a record cannot have the id 0, which boards return for missing records": ["编号不能是 0：主板用 0 表示没有这条记录", "編號不能是 0：控制板用 0 表示沒有這筆紀錄"],
  "{id} is negative; boards use ids from 1 on": ["{id} 是负数，主板的编号从 1 开始", "{id} 是負數，控制板的編號從 1 開始"],
  "{id} is also the id of {kind}[{number}]{same}": ["{id} 也是 {kind}[{number}] 的编号{same}", "{id} 也是 {kind}[{number}] 的編號{same}"],
  ", which is identical": ["，两者相同", "，兩者相同"],
  "{id} is also in {place}[{number}], {which}": ["{id} 在 {place}[{number}] 中也有，{which}", "{id} 在 {place}[{number}] 中也有，{which}"],
  "with the same values": ["数值相同", "數值相同"],
  "and boards differ in the copy used": ["各种主板采用的不同", "各種控制板採用的不同"],
  "{nests}; a virtual board plays {most}, other boards may differ": ["{nests}；虚拟主板最多 {most} 层，其他主板可能不同", "{nests}；虛擬控制板最多 {most} 層，其他控制板可能不同"],
  "{name} nests macros {count} levels deep": ["{name} 的宏嵌套了 {count} 层", "{name} 的巨集巢狀達 {count} 層"],
  "{name} runs itself{cycle}, so it never ends": ["{name} 会运行自己{cycle}，永远不会结束", "{name} 會執行自己{cycle}，永遠不會結束"],
  "{given}; the command takes {time} ms": ["{given}；这条指令需要 {time} 毫秒", "{given}；這個指令需要 {time} 毫秒"],
  "is not given": ["没有写时间", "沒有寫時間"],
  "is {time}": ["写的是 {time}", "寫的是 {time}"],
  "{id} stands for all servos, not for one": ["{id} 代表所有舵机，不是其中一个", "{id} 代表所有舵機，不是其中一顆"],
  "{move}; its cap is {cap}": ["{move}，上限为 {cap}", "{move}，上限是 {cap}"],
  "the project takes {size} bytes; the board has {memory}": ["项目需要 {size} 字节，主板有 {memory}", "專案需要 {size} 位元組，控制板有 {memory}"],
  "button {id} starts no macro": ["按键 {id} 不启动任何宏", "按鈕 {id} 不會啟動任何巨集"],
  "there is no {kind} {id}": ["没有 {kind} {id}", "沒有 {kind} {id}"],
  "there is no servo {id}": ["没有舵机 {id}", "沒有舵機 {id}"],
  "there is no joystick table {id}": ["没有按键表 {id}", "沒有搖桿定義表 {id}"],
  // servolink/doctor/environment.py
  "ModemManager is running, and nothing keeps it away from {device}": ["ModemManager 正在运行，没有规则让它避开 {device}", "ModemManager 正在執行，沒有規則讓它避開 {device}"],
  "or, if you have no modem: sudo systemctl disable --now ModemManager": ["如果没有调制解调器：sudo systemctl disable --now ModemManager", "如果沒有數據機：sudo systemctl disable --now ModemManager"],
  "a {chip} adapter ({vendor}:{product}) is plugged in and has no serial port, and brltty is installed": ["已插入 {chip} 转接器（{vendor}:{product}），但没有串口，而系统装有 brltty", "已插上 {chip} 轉接器（{vendor}:{product}），但沒有序列埠，而系統裝有 brltty"],
  "if you have no Braille display: sudo apt remove brltty": ["如果没有盲文显示器：sudo apt remove brltty", "如果沒有點字顯示器：sudo apt remove brltty"],
  "if you have a Braille display: sudo ln -s /dev/null /etc/udev/rules.d/{name}": ["如果有盲文显示器：sudo ln -s /dev/null /etc/udev/rules.d/{name}", "如果有點字顯示器：sudo ln -s /dev/null /etc/udev/rules.d/{name}"],
  "unplug the board and plug it in again": ["拔下主板再重新插上", "拔掉控制板再重新插上"],
  "to see its programs: servolink share --status": ["查看使用它的程序：servolink share --status", "查看使用它的程式：servolink share --status"],
  "process {pid} ({name}) has {path} open": ["进程 {pid}（{name}）打开了 {path}", "行程 {pid}（{name}）開啟了 {path}"],
  "close the program, or: kill {pid}": ["关闭该程序，或：kill {pid}", "關閉那個程式，或：kill {pid}"],
  "{path} is {time} ms": ["{path} 为 {time} ms", "{path} 是 {time} ms"],
  "{count} of {total} responses took {low} to {high} ms": ["{total} 个应答中有 {count} 个用时 {low} 到 {high} ms", "{total} 個回應中有 {count} 個費時 {low} 到 {high} ms"],
  "set the latency timer of the adapter to 1 ms on the computer with the adapter": ["在连接转接器的电脑上把延迟定时器设为 1 ms", "在連接轉接器的電腦上，將延遲計時器設為 1 ms"],
  "Device Manager, Ports, {name}, Properties, Port Settings, Advanced: Latency Timer 1 ms": ["设备管理器 > 端口 > {name} > 属性 > 端口设置 > 高级：延迟定时器 1 ms", "裝置管理員 > 連接埠 > {name} > 內容 > 連接埠設定 > 進階：延遲計時器 1 ms"],
  "until it is unplugged: echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer": ["到拔下为止：echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer", "到拔掉為止：echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer"],
  "for good: install the rule printed by `servolink doctor --print-udev`": ["永久：安装 `servolink doctor --print-udev` 输出的规则", "永久：安裝 `servolink doctor --print-udev` 印出的規則"],
  "`import hid` finds {path}": ["`import hid` 找到的是 {path}", "`import hid` 找到的是 {path}"],
  "Python finds no module hid": ["Python 找不到模块 hid", "Python 找不到模組 hid"],
  "pyusb finds no libusb": ["pyusb 找不到 libusb", "pyusb 找不到 libusb"],
  "Python finds no module usb": ["Python 找不到模块 usb", "Python 找不到模組 usb"],
  "the system is Linux inside Windows (WSL)": ["系统是 Windows 中的 Linux（WSL）", "系統是 Windows 裡的 Linux（WSL）"],
  "in PowerShell as administrator: usbipd list": ["在管理员 PowerShell 中：usbipd list", "在系統管理員的 PowerShell 中：usbipd list"],
  "servolink runs in a container ({name})": ["servolink 运行在容器中（{name}）", "servolink 在容器中執行（{name}）"],
  "for HID and USB: --device=/dev/hidraw0, --device=/dev/bus/usb": ["HID 和 USB：--device=/dev/hidraw0、--device=/dev/bus/usb", "HID 與 USB：--device=/dev/hidraw0、--device=/dev/bus/usb"],
  "this Python is packaged as {kind}": ["这个 Python 的打包方式是 {kind}", "這個 Python 的封裝方式是 {kind}"],
  "run servolink with the system's Python, in a virtual environment: python3 -m venv": ["用系统的 Python 在虚拟环境中运行 servolink：python3 -m venv", "用系統的 Python 在虛擬環境中執行 servolink：python3 -m venv"],
  "the address names {device}": ["地址写的是 {device}", "位址寫的是 {device}"],
  "use the other port: --board serial://{device}": ["改用另一个端口：--board serial://{device}", "改用另一個連接埠：--board serial://{device}"],
  // servolink/doctor/permissions.py
  "{path} belongs to {owner}:{group} with mode {mode}; {user} is in {groups}": ["{path} 属于 {owner}:{group}，模式 {mode}；{user} 所在的组：{groups}", "{path} 屬於 {owner}:{group}，模式 {mode}；{user} 所在的群組：{groups}"],
  "log out and in again, or for this terminal: newgrp {group}": ["注销并重新登录，或仅在此终端中：newgrp {group}", "登出再登入，或只在這個終端機中：newgrp {group}"],
  "log out and in again": ["注销并重新登录", "登出再登入"],
  "a service instead: SupplementaryGroups={group} in the unit": ["如果是服务：在 unit 中加入 SupplementaryGroups={group}", "如果是服務：在 unit 中加入 SupplementaryGroups={group}"],
  "run as the owner, or ask the owner: chmod g+rw {path}": ["以所有者身份运行，或请所有者执行：chmod g+rw {path}", "以擁有者身分執行，或請擁有者執行：chmod g+rw {path}"],
  "{path} tags this board with uaccess": ["{path} 给此主板加了 uaccess 标签", "{path} 為這塊控制板加上了 uaccess 標籤"],
  // servolink/errors.py
  "in a copy of servolink's repository: pip install '.[{name}]'": ["在 servolink 代码库的副本中：pip install '.[{name}]'", "在 servolink 原始碼的資料夾中：pip install '.[{name}]'"],
  // servolink/protocol/caption.py
  "'{text}' {fault}": ["“{text}”{fault}", "「{text}」{fault}"],
  "takes {size} bytes in {encoding}; a caption has 0..{most} bytes": ["用 {encoding} 编码需要 {size} 字节，名称最多 {most} 字节", "以 {encoding} 編碼需要 {size} 位元組，名稱最多 {most} 位元組"],
  "cannot be written in {encoding}": ["无法用 {encoding} 编码", "無法以 {encoding} 編碼"],
  "holds control characters; captions are plain text": ["含有控制字符，名称只能是普通文字", "含有控制字元，名稱只能是一般文字"],
  // servolink/protocol/json_errors.py
  "must be an integer, not {value}": ["必须是整数，不能是 {value}", "必須是整數，不能是 {value}"],
  "must be a number, not {value}": ["必须是数字，不能是 {value}", "必須是數字，不能是 {value}"],
  "must be text, not {value}": ["必须是文字，不能是 {value}", "必須是文字，不能是 {value}"],
  "must be a list, not {value}": ["必须是列表，不能是 {value}", "必須是清單，不能是 {value}"],
  "must be an object, not {value}": ["必须是对象，不能是 {value}", "必須是物件，不能是 {value}"],
  "must be one of {values}, not {value}": ["必须是 {values} 之一，不能是 {value}", "必須是 {values} 之一，不能是 {value}"],
  "must be a multiple of {unit}, the unit in which boards count, not {value}": ["必须是 {unit} 的倍数（主板的计数单位），不能是 {value}", "必須是 {unit} 的倍數（控制板的計數單位），不能是 {value}"],
  "{value} is outside {low}..{high}": ["{value} 超出 {low} 到 {high} 的范围", "{value} 超出 {low} 到 {high} 的範圍"],
  "has {count} items; at most {most}": ["有 {count} 项，最多 {most} 项", "有 {count} 項，最多 {most} 項"],
  "{value} has {count} characters; {most}": ["{value} 有 {count} 个字符，{most}", "{value} 有 {count} 個字元，{most}"],
  "at most {most}": ["最多 {most} 个", "最多 {most} 個"],
  "a caption has at most {most} bytes": ["名称最多 {most} 字节", "名稱最多 {most} 位元組"],
  "{value} holds control characters; captions are plain text": ["{value} 含有控制字符，名称只能是普通文字", "{value} 含有控制字元，名稱只能是一般文字"],
  "{field} is not a field; the fields are {fields}": ["没有字段 {field}，可用的字段：{fields}", "沒有欄位 {field}，可用的欄位：{fields}"],
  "{fields} {are} missing": ["缺少 {fields}", "缺少 {fields}"],
  // servolink/connection/explain.py
  "{packet} was not answered by {url} {how}: {causes}": ["{url} 没有应答 {packet}（{how}）：{causes}", "{url} 沒有回應 {packet}（{how}）：{causes}"],
  "in {time} s ({tries})": ["{time} 秒，{tries}", "{time} 秒，{tries}"],
  "{count} tries": ["尝试 {count} 次", "嘗試 {count} 次"],
  "1 try": ["尝试 1 次", "嘗試 1 次"],
  "{causes}; {count} received bytes were part of no frame": ["{causes}；另有 {count} 个字节不属于任何封包", "{causes}；另有 {count} 個位元組不屬於任何封包"],
  "and not sent in {time} s": ["{time} 秒内没有发出", "{time} 秒內沒有送出"],
  "the board answers other requests, so it may not know this one or what it asks about": ["主板应答了其他请求，可能不认识这个请求或其内容", "控制板回應了其他請求，可能不認得這個請求或其內容"],
  "the board has answered before, so it is busy or has lost power, or the line is bad": ["主板之前有应答，现在可能正忙、断电或线路不良", "控制板先前有回應，現在可能忙碌、斷電或線路不良"],
  "bytes come but no frame: the byte order or baud rate may be wrong, or this is another device": ["收到字节但没有完整的封包：字节序或波特率可能不对，或者这是其他设备", "收到位元組但沒有完整的封包：位元組順序或傳輸速率可能不對，或者這是其他裝置"],
  "nothing came at all: is the board on, is this its port, is it a data cable, are baud rate and byte order right? `servolink doctor` finds out": ["什么也没有收到：主板是否通电？端口对吗？是数据线吗？波特率和字节序对吗？可用 `servolink doctor` 检查", "什麼都沒有收到：控制板有通電嗎？連接埠對嗎？是傳輸線嗎？傳輸速率與位元組順序對嗎？可用 `servolink doctor` 檢查"],
  "the hub has sent it several times and got no response either: the board may not know it or what it asks about, or the line is bad": ["hub 多次发送也没有应答：主板可能不认识这个请求或其内容，或者线路不良", "hub 傳送多次也沒有回應：控制板可能不認得這個請求或其內容，或者線路不良"],
  // servolink/hub/hub.py
  "{url} refused to run what was prepared": ["{url} 拒绝运行已准备的内容", "{url} 拒絕執行已準備的內容"],
  // servolink/hub/methods/motion_methods.py
  "nothing was moved: this program has no stream {number}; begin one": ["没有移动：此页面的连续控制已结束，请重新开始", "沒有移動：這個頁面的連續操控已結束，請重新開始"],
  // servolink/hub/methods/feeds.py
  "{told}; trying again": ["{told}；正在重试", "{told}；正在重試"],
  // servolink/hub/methods/control_session.py
  "this program reads too slowly: {count} notifications were dropped": ["此页面读取太慢：已丢弃 {count} 条通知", "這個頁面讀取太慢：已捨棄 {count} 則通知"],
  // servolink/fleet/together.py
  "{board} is not connected: start `servolink fleet join` on its machine": ["{board} 没有连接：请在它的电脑上运行 `servolink fleet join`", "{board} 沒有連線：請在它的電腦上執行 `servolink fleet join`"],
  "{board} does not say what is stored on it{because}{problem}": ["{board} 没有说明存储了什么{because}{problem}", "{board} 沒有說明儲存了什麼{because}{problem}"],
  "{board} has no {kind} {name}": ["{board} 没有{kind} {name}", "{board} 沒有{kind} {name}"],
  "action or macro": ["动作或宏", "動作或巨集"],
  "{board} has an action and a macro {name}; say which with the type": ["{board} 同时有动作和宏 {name}，请说明是哪一种", "{board} 同時有動作與巨集 {name}，請指定是哪一種"],
  "{board} was prepared, and has not reported a start: look at the board": ["{board} 已准备好，但没有报告开始：请查看主板", "{board} 已準備好，但沒有回報開始：請查看控制板"],
  "{board} has started, and sent an unreadable result": ["{board} 已开始，但发回的结果无法读取", "{board} 已開始，但傳回的結果無法讀取"],
  // servolink/fleet/ready_run.py
  "the board was stopped while this was prepared; nothing was moved": ["准备时主板被停止了，没有移动", "準備時控制板被停止了，沒有移動"],
  "the prepared run has expired; nothing was moved": ["准备好的运行已过期，没有移动", "準備好的執行已過期，沒有移動"],
  // servolink/fleet/hub_session.py
  "the hub of {name} is not running; reconnecting": ["{name} 的 hub 没有运行，正在重新连接", "{name} 的 hub 沒有在執行，正在重新連線"],
  "the limits for {name} cannot be used: {reason}": ["{name} 的限位无法使用：{reason}", "{name} 的角度限制無法使用：{reason}"],
  // servolink/fleet/controller.py
  "{board} has not answered {method} within {time} s": ["{board} 在 {time} 秒内没有应答 {method}", "{board} 在 {time} 秒內沒有回應 {method}"],
  "{text}: its machine, or the network, may be slow or away; try again": ["{text}：它的电脑或网络可能很慢或已断开，请重试", "{text}：它的電腦或網路可能很慢或已斷線，請再試一次"],
  "{text}: the outcome is unknown; look at the board before sending the command again": ["{text}：结果未知，请先查看主板再重新发送", "{text}：結果不明，請先查看控制板再重新傳送"],
  "{board}: {method} may have been done or not: {reason}": ["{board}：{method} 可能已执行，也可能没有：{reason}", "{board}：{method} 可能已執行，也可能沒有：{reason}"],
  "the broker at {broker} is gone, or does not take what is sent; look at its machine and at the network": ["代理 {broker} 已断开或不接收消息，请检查它的电脑和网络", "broker {broker} 已斷線或不接收訊息，請檢查它的電腦與網路"],
  // servolink/fleet/commands.py
  "the board was stopped before this began": ["开始之前主板被停止了", "開始之前控制板被停止了"],
  "the command has expired on the way, or before its turn; nothing was done": ["命令在途中或轮到之前已过期，什么也没有做", "指令在途中或輪到之前已過期，什麼都沒有做"],
  "{method} is not allowed from afar: it needs {needed}, and {board} allows {role}": ["不允许远程执行 {method}：需要 {needed}，而 {board} 只允许 {role}", "不允許遠端執行 {method}：需要 {needed}，而 {board} 只允許 {role}"],
  "{count} commands of {board} wait already": ["{board} 已有 {count} 条命令在等待", "{board} 已有 {count} 個指令在等待"],
  "the command was interrupted, and the outcome is unknown; the command is not repeated": ["命令被中断，结果未知，不会重复执行", "指令被中斷，結果不明，不會重複執行"],
  // servolink/fleet/roster.py
  "its state cannot be read: {reason}": ["无法读取它的状态：{reason}", "無法讀取它的狀態：{reason}"],
  "a line of its log cannot be read": ["无法读取它的一行日志", "無法讀取它的一行記錄"],
  // servolink/fleet/groups.py
  "{file}, line {line}: {text}": ["{file} 第 {line} 行：{text}", "{file} 第 {line} 行：{text}"],
  "{file} cannot be read: {reason}; correct or remove the file": ["无法读取 {file}：{reason}；请修正或删除该文件", "無法讀取 {file}：{reason}；請修正或刪除這個檔案"],
  // servolink/project/project_file.py
  "is not a project file: a JSON object is needed, not {value}": ["不是项目文件：需要 JSON 对象，而不是 {value}", "不是專案檔：需要 JSON 物件，而不是 {value}"],
  "{version} is newer than {known}, the newest this servolink reads; update servolink": ["版本 {version} 比此 servolink 能读取的 {known} 新，请更新 servolink", "版本 {version} 比這個 servolink 能讀取的 {known} 新，請更新 servolink"],
  // servolink/project/model.py
  "{kind} {id} '{name}'": ["{kind} {id}“{name}”", "{kind} {id}「{name}」"],
  // servolink/project/record_lookup.py
  // servolink/project/model.py
  "{kind} {id} exists twice; remove a copy, or change an id": ["{kind} {id} 出现了两次，请删除一份或更改编号", "{kind} {id} 出現了兩次，請刪除一份或更改編號"],
  // servolink/project/speed.py
  "step {number} asks servo {id} {how}": ["第 {number} 步要求舵机 {id} {how}", "第 {number} 步要求舵機 {id} {how}"],
  "for {speed} degrees/s": ["达到 {speed} 度/秒", "達到每秒 {speed} 度"],
  "to turn in no time": ["瞬间转到", "瞬間轉到"],
  "{name}, {text}": ["{name}，{text}", "{name}，{text}"],
  // servolink/project/transfer/import_plan.py
  "{name} is listed more than once": ["{name} 在主板的列表中出现多次", "{name} 在控制板的清單中出現多次"],
  "{name} is listed and not returned": ["{name} 在主板的列表中，但读不到", "{name} 在控制板的清單中，但讀不到"],
  // servolink/project/transfer/results.py
  "the project may not fit: {needed} bytes more than the present content; the board has {free} bytes free, {unit}": ["项目可能放不下：比现有内容多 {needed} 字节，主板剩余 {free} 字节，{unit}", "專案可能放不下：比現有內容多 {needed} 位元組，控制板剩餘 {free} 位元組，{unit}"],
  "assuming memory figures in bytes": ["按字节计算", "以位元組計算"],
  "counted in units of {unit} bytes": ["以 {unit} 字节为单位", "以 {unit} 位元組為單位"],
  // servolink/project/transfer/read.py
  "{kind} {id}": ["{kind} {id}", "{kind} {id}"],
  "lists": ["列表", "清單"],
  // servolink/project/transfer/importing.py
  "backup": ["备份", "備份"],
  "project id {id}": ["项目编号 {id}", "專案識別碼 {id}"],
  // servolink/project/transfer/import_run.py
  "everything on the board": ["主板上的全部内容", "控制板上的所有內容"],
  // servolink/project/transfer/writing.py
  "servo parameters": ["舵机参数", "舵機參數"],
  "active joystick table {id}": ["正在使用的按键表 {id}", "使用中的搖桿定義表 {id}"],
  "{item} cannot be written to a board: {reason}": ["{item} 无法写入主板：{reason}", "{item} 無法寫入控制板：{reason}"],
  // servolink/project/transfer/pinned.py
  "the connection to {url} was lost and restored in the middle of the transfer, perhaps to another board; start the transfer again": ["传输途中与 {url} 的连接断开后又恢复，可能已是另一块主板，请重新开始", "傳輸途中與 {url} 的連線中斷後又恢復，可能已是另一塊控制板，請重新開始"],
  // servolink/virtual/player.py
  "macro {id} runs itself": ["宏 {id} 会运行自己", "巨集 {id} 會執行自己"],
  "macro {id} is missing, or has unplayable values": ["没有宏 {id}，或其数值无法播放", "沒有巨集 {id}，或其數值無法播放"],
  "action {id} is missing, or has unplayable values": ["没有动作 {id}，或其数值无法播放", "沒有動作 {id}，或其數值無法播放"],
  "macros are nested more than {most} levels deep, the limit of a virtual board; other boards may differ": ["宏嵌套超过 {most} 层，这是虚拟主板的上限，其他主板可能不同", "巨集巢狀超過 {most} 層，這是虛擬控制板的上限，其他控制板可能不同"],
  // servolink/virtual/dry_run.py
  "cannot be played: {reason}": ["无法播放：{reason}", "無法播放：{reason}"],
  // servolink/twin/trial.py
  "{name}: {reason}; `servolink project check` explains it": ["{name}：{reason}；详见“项目”页的检查", "{name}：{reason}；詳見「專案」畫面的檢查"],
  // servolink/twin/body.py
  "{part}; give it a mass, a length or shapes": ["{part}；请为它写上质量、长度或形状", "{part}；請為它寫上質量、長度或形狀"],
  "figure.joints: {part} turns and weighs nothing": ["模型的关节 {part} 会转动，却没有重量", "模型的關節 {part} 會轉動，卻沒有重量"],
  "figure.body.mass: {mass} kg is too little, as single parts weigh {parts} kg": ["模型的总质量 {mass} kg 太小，各部分已有 {parts} kg", "模型的總質量 {mass} kg 太小，各部分已有 {parts} kg"],
  "figure.body: give the mass of the robot or the density of its parts, not both": ["模型只能写机器人的质量或各部分的密度，不能两者都写", "模型只能寫機器人的質量或各部分的密度，不能兩者都寫"],
  "figure.joints: the base stands free and weighs nothing; give a mass or shapes to a part that no servo turns, or write that the base is bolted": ["模型的底座没有固定，也没有重量：请为不由舵机转动的部分写上质量或形状，或写明底座已固定", "模型的底座沒有固定，也沒有重量：請為不由舵機轉動的部分寫上質量或形狀，或寫明底座已固定"],
  // servolink/twin/simulation.py
  "the twin needs MuJoCo; {how} ({error})": ["数字孪生需要 MuJoCo；{how}（{error}）", "數位分身需要 MuJoCo；{how}（{error}）"],
  "figure: MuJoCo cannot build the body: {reason}": ["MuJoCo 无法用此模型建立身体：{reason}", "MuJoCo 無法用這個模型建立身體：{reason}"],
  // servolink/twin/worker.py
  "the process with the physics was ended from outside; try again": ["物理计算的进程被外部结束，请重试", "物理計算的行程被外部結束，請再試一次"],
};

/** @param {0 | 1} at */
const templates = (at) => Object.entries(MESSAGES).map(([english, both]) => ({ english, translation: both[at] }));

/** Templates of messages by language. */
export const TEMPLATES = { "zh-Hans": templates(0), "zh-Hant": templates(1) };
